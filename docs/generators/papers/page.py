"""The page with the figures of the papers, each drawn again from our own data."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from generators.papers.figures import FIGURES, draw_figure

PAGE = "explanation/papers.md"
PICTURES = Path("explanation/papers")

_HEAD = """\
# Figures of the papers

These pictures show what figures of Nielson (1993) and of Kim, Kim and Shin (1995) show. The papers
print no numbers, so the data differ.
"""


def pages(source: Path) -> Iterator[tuple[str, str]]:
    """Yield the page; a picture that is there is not drawn again."""
    folder = source / PICTURES
    folder.mkdir(parents=True, exist_ok=True)
    parts = [_HEAD]
    for name, figure in FIGURES.items():
        path = folder / f"{name}.svg"
        if not path.exists():
            draw_figure(path, name)
        title = " ".join(figure.title.split())
        parts.append(f"\n## {name}\n\n{title}.\n\n![{title}](papers/{path.name})\n")
    yield PAGE, "".join(parts)
