"""The loopback driver's recording: every written setpoint in a plain binary file."""

from __future__ import annotations

import struct
from pathlib import Path

from orientd.driver import Setpoint

_RECORD = struct.Struct("@q16d")


def pack_setpoint(setpoint: Setpoint) -> bytes:
    """Return the bytes of one recorded setpoint."""
    return _RECORD.pack(
        setpoint.time_ns,
        *setpoint.q,
        *setpoint.omega_body,
        *setpoint.alpha_body,
        *setpoint.position,
        *setpoint.velocity,
    )


def read_recording(path: Path | str) -> list[Setpoint]:
    """Return the setpoints in a recording, oldest first; an incomplete last one is left out."""
    content = Path(path).read_bytes()
    content = content[: len(content) // _RECORD.size * _RECORD.size]
    return [
        Setpoint(f[0], f[1:5], f[5:8], f[8:11], f[11:14], f[14:17])
        for f in _RECORD.iter_unpack(content)
    ]
