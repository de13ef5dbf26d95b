"""Let curves and motions draw themselves, without importing the drawing package."""

from __future__ import annotations

from importlib.metadata import entry_points
from typing import TYPE_CHECKING, Any

from orientd.errors import OrientdError

if TYPE_CHECKING:
    from pathlib import Path

GROUP = "orientd.renderers"
"""Entry points by which a package offers to draw; its module has ``draw_alone`` and ``png_of``."""


class Drawable:
    """A value that draws itself to a file, and shows itself in a notebook."""

    __slots__ = ()

    def plot(self, path: str | Path, *, title: str = "") -> None:
        """Draw the orientations, their velocity and acceleration; needs Matplotlib.

        Args:
            path: the file; its ending is .png, .svg or .pdf.
            title: above the picture; the name of the method by default.

        Raises:
            OrientdError: the file cannot be written, or Matplotlib is not installed.
        """
        _renderer().draw_alone(path, self, title=title)

    def _repr_png_(self) -> bytes | None:
        picture: bytes | None = _renderer().png_of(self)
        return picture


def _renderer() -> Any:  # noqa: ANN401 - a module
    for entry in entry_points(group=GROUP):
        return entry.load()
    raise OrientdError(
        f"no installed package draws curves (entry points {GROUP!r}); install orientd again"
    )
