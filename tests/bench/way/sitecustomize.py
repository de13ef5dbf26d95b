"""Write down when each function of orientd is called.

Python itself loads this first, in every process that has this folder on its path.  Each process
has a file of its own in the folder that ``ORIENTD_WAY`` names.  A line is the time (monotonic, ns),
the function, and the type whose method it is.
"""

from __future__ import annotations

import os
import sys
import threading
import time
from inspect import CO_OPTIMIZED
from types import CodeType, FrameType

_FOLDER = os.environ.get("ORIENTD_WAY")
_ROOTS = ("/orientd/", "/drivers/", "/sim/")
_names: dict[CodeType, str] = {}
_files: dict[int, int] = {}


def _name(code: CodeType) -> str:
    """Return what to call a function; empty if it is not one of ours."""
    path = code.co_filename
    root = next((path.rfind(root) for root in _ROOTS if root in path), -1)
    is_ours = root >= 0 and "_pb2" not in path and "site-packages" not in path
    # Neither the body of a module or class nor a comprehension is a function.
    is_body = not code.co_flags & CO_OPTIMIZED or code.co_name.startswith("<")
    return f"{path[root + 1 :]}:{code.co_qualname}" if is_ours and not is_body else ""


def _file() -> int:
    """Return the file of this process, which may have been forked since the last call."""
    process = os.getpid()
    if process not in _files:
        flags = os.O_WRONLY | os.O_CREAT | os.O_APPEND
        _files[process] = os.open(f"{_FOLDER}/{process}", flags, 0o600)
    return _files[process]


def _note(frame: FrameType, event: str, _: object) -> None:
    if event != "call":
        return
    code = frame.f_code
    name = _names.get(code)
    if name is None:
        name = _names[code] = _name(code)
    if not name:
        return
    owner = ""
    if code.co_argcount and code.co_varnames[0] in ("self", "cls"):
        me = frame.f_locals.get(code.co_varnames[0])
        owner = (me if isinstance(me, type) else type(me)).__qualname__
    os.write(_file(), f"{time.monotonic_ns()} {name} {owner}\n".encode())


if _FOLDER:
    threading.setprofile(_note)
    sys.setprofile(_note)
