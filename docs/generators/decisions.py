"""Records, which stand beside the code that they are about, as pages of the site."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

_EMULATORS = {
    "emulated-dynamixel": "emulated_dynamixel/README.md",
    "emulated-ur": "emulated_ur/README.md",
    "ur-methods": "emulated_ur/METHODS.md",
}
_SKIPPED = {".venv", "build", "docs", ".git"}


def pages(source: Path) -> Iterator[tuple[str, str]]:
    """Yield a page for each ``DECISION.md`` of the tree, which it includes, and for emulators."""
    root = source.parent
    for name, file in _EMULATORS.items():
        yield f"reference/{name}.md", f"```{{include}} ../../sim/{file}\n```\n"
    names = []
    for record in sorted(root.rglob("DECISION.md")):
        place = record.relative_to(root)
        if place.parts[0] in _SKIPPED:
            continue
        name = "-".join(place.parts[:-1])
        yield (
            f"explanation/decisions/{name}.md",
            f"```{{include}} ../../../{place.as_posix()}\n```\n\n"
            f"This record stands in `{place.as_posix()}`.\n",
        )
        names.append(name)
    text = (source / "explanation" / "decisions" / "overview.txt").read_text(encoding="utf-8")
    contents = ["```{toctree}", ":maxdepth: 1", "", *names, "documentation", "```", ""]
    yield "explanation/decisions/index.md", text + "\n" + "\n".join(contents)
