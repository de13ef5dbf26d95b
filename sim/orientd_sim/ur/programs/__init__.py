"""What programs do, tick by tick: motions, and the few statements of URScript that are known."""

from __future__ import annotations

from typing import TYPE_CHECKING

from orientd.lazy import lazily

if TYPE_CHECKING:
    from orientd_sim.ur.programs.motions import (
        Ticks,
        jog,
        move_joints,
        move_line,
        press,
        stop,
        touch,
    )
    from orientd_sim.ur.programs.statements import (
        Statement,
        UnknownStatementError,
        parse,
        perform,
    )

__getattr__ = lazily(__name__)
