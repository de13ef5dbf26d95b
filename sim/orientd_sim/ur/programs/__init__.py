"""What programs do, tick by tick: motions, and the few statements of URScript that are known."""

from orientd_sim.ur.programs.motions import (
    Ticks,
    jog,
    move_joints,
    move_line,
    press,
    push,
    stop,
    touch,
)
from orientd_sim.ur.programs.statements import (
    Statement,
    UnknownStatementError,
    finite,
    parse,
    perform,
)
