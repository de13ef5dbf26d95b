"""Write a motion to one file; see :mod:`orientd.planner.storage.saved` for what is in it."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from orientd.errors import OrientdError
from orientd.whole_file import written

if TYPE_CHECKING:
    from orientd.planner.motion import Motion

FORMAT = "orientd motion"
VERSION = 1

OTHER_FORMATS = {".csv", ".json", ".mcap", ".parquet", ".txt", ".yaml", ".yml"}
"""Endings that say what a saved motion is not."""


def save_motion(motion: Motion, path: str | Path) -> None:
    """Write a motion to a file.

    Raises:
        OrientdError: the file cannot be written, or its name is that of another format.
    """
    path = Path(path)
    if path.suffix in OTHER_FORMATS:
        raise OrientdError(
            f"a motion is saved as .npz, got {path.name!r}; `orientd plan --output` writes samples"
        )
    request = motion.request.given()
    header = {
        "format": FORMAT,
        "version": VERSION,
        "id": motion.id,
        "request": {
            **request,
            "keyframes": [asdict(keyframe) for keyframe in motion.request.keyframes],
            "limits": None if motion.request.limits is None else asdict(motion.request.limits),
        },
        "limits": asdict(motion.limits),
        "period": motion.period,
        "duration": motion.duration,
        "start_time": motion.start_time,
        "end_time": motion.end_time,
        "certificate": asdict(motion.certificate),
        "rough": None if motion.rough is None else asdict(motion.rough),
        "first_joints": motion.first_joints,
        "last_joints": motion.last_joints,
        "joint_shares": motion.joint_shares,
    }
    arrays: dict[str, Any] = {
        "header": np.array(json.dumps(header, default=_plain)),
        "rows": motion.rows(0, motion.record_count),
        "keyframe_times": motion.keyframe_times,
        "earlier": np.array(motion.path.joints_before(0), dtype=np.float64),
    }
    if motion.before is not None:
        arrays["q_before"], arrays["position_before"] = motion.before
    with written(path) as part, part.open("wb") as file:
        np.savez(file, **arrays)


def _plain(content: object) -> object:
    """Return what JSON holds in place of an array or a number of NumPy's."""
    if isinstance(content, np.ndarray | np.generic):
        return content.tolist()
    raise TypeError(f"a {type(content).__name__} among the options cannot be saved")
