"""URScript, the language of a UR controller: programs that run one cycle at a time."""

from __future__ import annotations

from orientd_sim.ur.urscript.compiler import Script, compile_script
from orientd_sim.ur.urscript.lexer import ScriptError, Splitter
from orientd_sim.ur.urscript.program import Program, Ticks
from orientd_sim.ur.urscript.values import Array, Datum, Pose, pose_of, written
