"""URScript, the language of a UR controller: programs that run one cycle at a time."""

from __future__ import annotations

from emulated_ur.urscript.compiler import Script, compile_script
from emulated_ur.urscript.lexer import ScriptError, Splitter
from emulated_ur.urscript.program import Program, Ticks
from emulated_ur.urscript.values import Array, Datum, Pose, pose_of, written
