"""Write a motion to one file; see :mod:`orientd.planner.saved` for what is in it."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from orientd.errors import OrientdError
from orientd.whole_file import written

FORMAT = "orientd motion"
VERSION = 1

OTHER_FORMATS = {".csv", ".json", ".mcap", ".parquet", ".txt", ".yaml", ".yml"}
"""Endings that say what a saved motion is not."""


def write_archive(path: str | Path, header: Mapping[str, Any], arrays: Mapping[str, Any]) -> None:
    """Write what a motion consists of to a file.

    Args:
        path: the file, by custom ``.npz``.
        header: plain values, and dataclasses as dictionaries; the format goes before them.
        arrays: by the name that each has in the archive.

    Raises:
        OrientdError: the file cannot be written, or its name is that of another format.
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
    """Return what JSON holds in place of an array or a number of NumPy's."""
    if isinstance(content, np.ndarray | np.generic):
        return content.tolist()
    raise TypeError(f"a {type(content).__name__} among the options cannot be saved")
