"""A motion in one file, with its certificate: numbers in an ``.npz`` archive, no code.

The archive holds ``header``, a JSON text that begins with the format and its version.  ``rows`` has
the state, axis angles and their velocities of every record.  The other arrays of a motion follow. A
motion from a file has the saved records, to the last bit.  The file has no curve, so between two
records the motion is a cubic.
"""

from __future__ import annotations

import json
import struct
import sys
import zipfile
from pathlib import Path
from tokenize import TokenError
from typing import Any

import numpy as np

from orientd.errors import OrientdError
from orientd.files import check_regular
from orientd.mechanism.figure import Figure, Loss
from orientd.model.cones import read_cones
from orientd.model.limits import Limits
from orientd.model.request import Keyframe, MotionRequest
from orientd.planner.certify.certificate import Certificate, Peak
from orientd.planner.facts import HISTORY
from orientd.planner.motion import Motion
from orientd.planner.path import RecordedPath
from orientd.planner.recorded import STATE_FLOATS
from orientd.planner.saving import FORMAT, VERSION

_AXES = ("axis_velocity", "axis_acceleration", "axis_jerk")

_DAMAGES = (
    *(zipfile.BadZipFile, struct.error, EOFError, RuntimeError, SyntaxError, TokenError),
    *(ValueError, LookupError, TypeError, AttributeError, ArithmeticError, MemoryError),
)
"""Exceptions of the archive and array readers for damaged bytes."""


def load_motion(path: str | Path) -> Motion:
    """Return the motion in a file, which is equal to the saved one.

    Raises:
        OrientdError: the file cannot be read, is not a motion, or is of a later version.
    """
    try:
        check_regular(Path(path))
        with zipfile.ZipFile(path) as archive:
            names = archive.namelist()
            packed = any(part.compress_type != zipfile.ZIP_STORED for part in archive.infolist())
        if "header.npy" not in names:
            raise ValueError("no header")
        if packed:
            raise ValueError("compressed, which could hold more than there is memory for")
        with np.load(path, allow_pickle=False) as archive:
            arrays = dict(archive)
        # NumPy makes a str even of characters that do not exist, on which others crash.
        characters = "utf-32-le" if sys.byteorder == "little" else "utf-32-be"
        header = json.loads(arrays["header"].tobytes().decode(characters).rstrip("\0"))
        if header["format"] != FORMAT:
            raise ValueError(f"format {header['format']!r}")
        version = header["version"]
    except OSError as error:
        raise OrientdError(f"cannot read {path}: {error.strerror or error}") from error
    except _DAMAGES as error:
        raise OrientdError(f"{path} is not a motion saved by orientd: {error}") from error
    if version != VERSION:
        raise OrientdError(
            f"{path} has version {version!r} of the format of motions; expected {VERSION}"
        )
    try:
        return _motion(header, arrays)
    except _DAMAGES as error:
        raise OrientdError(f"{path} is damaged: {error}") from error


def _motion(header: dict[str, Any], arrays: dict[str, Any]) -> Motion:
    rows, before = arrays["rows"], None
    if rows.dtype != np.float64 or rows.ndim != 2 or rows.shape[1] < STATE_FLOATS or not len(rows):
        raise ValueError(f"rows must have {STATE_FLOATS} columns or more, got {rows.shape}")
    if not np.isfinite(rows).all():
        raise ValueError("rows must be finite")
    if "q_before" in arrays:
        before = arrays["q_before"], arrays["position_before"]
    if rows.shape[1] != STATE_FLOATS + 2 * header.get("axes", 0):
        raise OrientdError(
            f"the motion {header['id']} was saved by a version whose stops do not count the "
            "device's axes; plan it again"
        )
    return Motion(
        id=header["id"],
        request=_request(header["request"]),
        limits=_limits(header["limits"]),
        period=header["period"],
        path=RecordedPath(
            header["period"], header["duration"], rows, arrays["earlier"].reshape(HISTORY, -1)
        ),
        start_time=header["start_time"],
        end_time=header["end_time"],
        keyframe_times=arrays["keyframe_times"],
        record_count=len(rows),
        certificate=_certificate(header["certificate"]),
        first_joints=tuple(header["first_joints"]),
        last_joints=tuple(header["last_joints"]),
        before=before,
        keep_out=read_cones(header.get("keep_out", [])),
    )


def _request(given: dict[str, Any]) -> MotionRequest:
    keyframes = [
        Keyframe(**one | {"q": tuple(one["q"]), "position": _place(one["position"])})
        for one in given["keyframes"]
    ]
    limits = None if given["limits"] is None else _limits(given["limits"])
    cones = read_cones(given.get("keep_out", []))
    return MotionRequest(**{**given, "keyframes": keyframes, "limits": limits, "keep_out": cones})


def _place(position: list[float] | None) -> Any:  # noqa: ANN401 - three numbers, if any
    return position and tuple(position)


def _limits(given: dict[str, Any]) -> Limits:
    return Limits(**{**given, **{name: tuple(given[name]) for name in _AXES}})


def _certificate(given: dict[str, Any]) -> Certificate:
    peaks = {name: Peak(**given[name]) for name in given if name.startswith("peak_")}
    figures = tuple(Figure(*figure) for figure in given["figures"])
    losses = tuple(Loss(*loss) for loss in given.get("losses", ()))
    given = {"usual_stop_time": given["stop_time"], **given}  # not in files of earlier versions
    return Certificate(
        **{**given, **peaks, "figures": figures, "losses": losses, "notes": tuple(given["notes"])}
    )
