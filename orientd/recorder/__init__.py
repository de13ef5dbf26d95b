"""Recordings: what was planned, sent and measured, in MCAP files that viewers open.

Needs the extra ``record``: ``mcap`` and Foxglove's schemas, imported where a file
is read or written.

Other packages import from ``columns``, ``mcap_file``, ``planned``, ``reader``, ``session``,
``tables`` and ``writer``.
"""

from __future__ import annotations

from typing import Any

_MOVED = {
    "Orientations": "orientd_replay.orientations.Orientations",
    "read_orientations": "orientd_replay.orientations.read_orientations",
}
"""Names of version 0.2 and where they are now."""


def __getattr__(name: str) -> Any:  # noqa: ANN401 - the signature PEP 562 asks for
    if name in _MOVED:
        # `from orientd.recorder import` hides the message of an AttributeError.
        raise ImportError(f"orientd.recorder.{name} is now {_MOVED[name]}")
    raise AttributeError(f"module 'orientd.recorder' has no attribute {name!r}")
