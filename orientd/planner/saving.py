"""Write a motion to one file; :mod:`orientd.planner.saved` describes its content."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from orientd.errors import OrientdError
from orientd.files import written

FORMAT = "orientd motion"
VERSION = 1

OTHER_FORMATS = {".csv", ".json", ".mcap", ".parquet", ".txt", ".yaml", ".yml"}
"""Suffixes of other formats than a saved motion."""


def write_archive(path: str | Path, header: Mapping[str, Any], arrays: Mapping[str, Any]) -> None:
    """Write the parts of a motion to a file.

    Args:
        path: the file, usually ``.npz``.
        header: plain values, and dataclasses as dictionaries; the format is added in front.
        arrays: by their names in the archive.

    Raises:
        OrientdError: the file cannot be written, or its name has the suffix of another format.
    """
    path = Path(path)
    if path.suffix in OTHER_FORMATS:
        raise OrientdError(
            f"a motion is saved as .npz, got {path.name!r}; `orientd plan --output` writes samples"
        )
    text = json.dumps({"format": FORMAT, "version": VERSION, **header}, default=_plain)
    with written(path) as part, part.open("wb") as file:
        np.savez(file, header=np.array(text), **arrays)


def _plain(content: object) -> object:
    """Return the JSON form of a NumPy array or number."""
    if isinstance(content, np.ndarray | np.generic):
        return content.tolist()
    raise TypeError(f"a {type(content).__name__} among the options cannot be saved")
