"""The reference of the control protocol, from the comments of its definition."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

from orientd import protocol

_SOURCE = Path(protocol.__file__).with_name("control.proto")
_RPC = re.compile(r"rpc (\w+)\((stream )?(\w+)\) returns \((stream )?(\w+)\)")
_FIELD = re.compile(r"(repeated |optional )?(map<[^>]+>|[\w.]+) (\w+) = (\d+)( \[.*\])?;")
_VALUE = re.compile(r"(\w+) = (\d+);")


def pages(source: Path) -> Iterator[tuple[str, str]]:
    """Yield the page of the protocol."""
    del source
    lines = _SOURCE.read_text(encoding="utf-8").splitlines()
    head, body = _head(lines)
    yield "reference/protocol.md", "\n".join(["# Protocol", "", *head, "", *_body(body)])


def _head(lines: list[str]) -> tuple[list[str], list[str]]:
    """Return the comment that the file begins with as text, and what follows it."""
    end = next(k for k, line in enumerate(lines) if not line.startswith("//"))
    text: list[str] = []
    is_listing = False
    for line in lines[:end]:
        said = line[2:].removeprefix(" ")
        # Columns and bullets stay as they were laid out.
        begins = said.startswith("  ")
        if begins != is_listing:
            text += ["```text"] if begins else ["```"]
            is_listing = begins
        text.append(said)
    return text + (["```"] if is_listing else []), lines[end:]


def _body(lines: list[str]) -> Iterator[str]:
    said: list[str] = []
    open_blocks: list[str] = []
    for line in map(str.strip, lines):
        if line.startswith("//"):
            said.append(line[2:].strip())
            continue
        opened = re.match(r"(service|message|enum|oneof) (\w+) \{(\})?", line)
        if opened:
            kind, name, is_closed = opened.groups()
            if kind == "service":
                yield f"\n## Service `{name}`\n"
            elif kind == "oneof":
                yield f"|  | *one of `{name}`:* {' '.join(said)} |"
            else:
                yield from (
                    "",
                    f"### `{name}`" if kind == "message" else f"### `{name}` (enum)",
                    "",
                )
                yield from (" ".join(said) or "", "")
                if not is_closed:
                    first = "field" if kind == "message" else "value"
                    yield from (f"| {first} | meaning |", "|---|---|")
            if not is_closed:
                open_blocks.append(kind)
        elif line.startswith("}"):
            closed = open_blocks.pop() if open_blocks else ""
            if closed == "service":
                yield "\n## Messages\n"
        elif line.startswith("rpc"):
            found = _RPC.match(line)
            if found is None:
                raise ValueError(f"a call that cannot be read: {line}")
            if not said:
                raise ValueError(f"{found[1]} has no comment")
            sent, answered = ("stream of " if found[2] else ""), ("stream of " if found[4] else "")
            yield (
                f"\n### `{found[1]}`\n\n{' '.join(said)}\n\n"
                f"Takes {sent}[`{found[3]}`](#{found[3].lower()}), "
                f"returns {answered}[`{found[5]}`](#{found[5].lower()}).\n"
            )
        elif found := _FIELD.match(line):
            label = (found[1] or "").strip()
            kind = f"{label} {found[2]}".strip().replace("<", "&lt;")
            yield f"| `{found[3]}` = {found[4]}<br>*{kind}* | {' '.join(said)} |"
        elif found := _VALUE.match(line):
            yield f"| `{found[1]}` = {found[2]} | {' '.join(said)} |"
        said = []
