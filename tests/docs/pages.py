"""The code blocks of the pages in docs/, as a reader meets them.

A block whose caption is the name of a file is that file, also if it includes a file of the sources.
One that is captioned "In a terminal of its own" goes on until the page ends; ``text`` after a shell
is what it prints, with ``...`` for what differs from time to time.  A block after a comment
``% checked: WHY`` needs what a test has not; its commands are held against the command line only.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

DOCS = Path(__file__).parents[2] / "docs"
OWN_TERMINAL = "In a terminal of its own"
REASONS = {
    "a real device",
    "root",
    "systemd",
    "an authority",
    "another user",
    "another machine",
    "another terminal",
    "a real-time host",
    "a cluster",
    "LeRobot",
    "an antenna program",
}

_INCLUDED = re.compile(
    r"^```\{literalinclude\} (?P<source>[^\n]*)\n"
    r":caption: (?P<caption>[^\n]*)\n:language: (?P<language>\w+)\n```$",
    re.MULTILINE,
)
_BLOCK = re.compile(
    r"(?:^% checked: (?P<why>[^\n]*)\n)?"
    r"^(?P<indent> *)```(?:\{code-block\} )?(?P<language>\w+)\n"
    r"(?::caption: (?P<caption>[^\n]*)\n\n)?"
    r"(?P<text>.*?)^ *```$",
    re.MULTILINE | re.DOTALL,
)


@dataclass(frozen=True)
class Block:
    """One of them.

    Attributes:
        language: ``sh``, ``python``, ``yaml``, ``toml`` or ``text``.
        caption: above it; empty without.
        text: what is in it.
        why_not: why it is not run; empty where it is.
        place: page and line, for messages.
    """

    language: str
    caption: str
    text: str
    why_not: str
    place: str


def pages() -> list[Path]:
    """Return every tutorial and how-to guide."""
    found = [*(DOCS / "tutorials").glob("*.md"), *(DOCS / "how-to").glob("*.md")]
    return sorted(path for path in found if path.name != "index.md")


def blocks(page: Path) -> list[Block]:
    """Return the code blocks of a page in their order."""
    text = _INCLUDED.sub(
        lambda match: (
            f"```{{code-block}} {match['language']}\n:caption: {match['caption']}\n\n"
            f"{(page.parent / match['source']).read_text(encoding='utf-8')}```"
        ),
        page.read_text(encoding="utf-8"),
    )
    found = [
        Block(
            language=match["language"],
            caption=match["caption"] or "",
            text=match["text"],
            why_not=match["why"] or "",
            place=f"{page.name}:{text[: match.start()].count(chr(10)) + 1}",
        )
        for match in _BLOCK.finditer(text)
        if not match["indent"]
    ]
    assert len(re.findall(r"^```(?:\{code-block\}|\w)", text, re.MULTILINE)) == len(found), page
    return found
