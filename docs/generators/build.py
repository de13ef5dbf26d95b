"""Write the pages that are made from the code, when Sphinx begins."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from generators import (
    cases,
    command_line,
    decisions,
    families,
    formulas,
    messages,
    passes,
    protocol,
    python_names,
    schemas,
    searched,
    sines,
)
from generators.papers import page as papers

WHOLLY_MADE = ("reference/command-line", "reference/python")
MADE_BY = "% Made from the code when the documentation is built; edit the code.\n\n"


def _write(source: Path) -> None:
    made = set()
    for module in (
        command_line,
        schemas,
        messages,
        cases,
        protocol,
        python_names,
        families,
        decisions,
        sines,
        passes,
        papers,
    ):
        for name, text in module.pages(source):
            path = source / name
            text = MADE_BY + text if path.suffix == ".md" else text
            path.parent.mkdir(parents=True, exist_ok=True)
            # What has not changed keeps its time, so that a second build is quick.
            if not path.exists() or path.read_text(encoding="utf-8") != text:
                path.write_text(text, encoding="utf-8")
            made.add(path)
    for folder in WHOLLY_MADE:
        for path in set((source / folder).iterdir()) - made:
            path.unlink()


def setup(app: Any) -> dict[str, Any]:  # noqa: ANN401 - Sphinx's application
    """Make the pages before Sphinx looks for them."""
    app.connect("config-inited", lambda app, _: _write(Path(app.srcdir)))
    app.connect("source-read", searched.add)
    app.connect("build-finished", formulas.copy)
    return {"parallel_read_safe": True}
