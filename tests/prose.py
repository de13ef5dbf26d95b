"""Check the prose of the project: words, long sentences, semicolons.  Run by ``make check``.

``prose.toml`` counts the findings by folder, which only shrink.  ``prose.py FOLDER`` lists them.
"""

from __future__ import annotations

import ast
import re
import subprocess
import sys
import tomllib
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[1]
RULES = tomllib.loads((ROOT / "tests" / "prose.toml").read_text(encoding="utf-8"))
WORDS = {
    re.compile(rf"\b(?:{one})\b", re.IGNORECASE): better for one, better in RULES["words"].items()
}

MOST_WORDS = 28

CLAUSE = re.compile(r"(What|Who|Whose)\b(?! else)[^?]*[.:;]$")
CODE = re.compile(r"``[^`]*``|`[^`]*`(?:__?)?|:\w+:|\$[^$]*\$|https?://\S+|\{[\w-]+\}|<[^>]+>")
ABBREVIATION = re.compile(r"\b(e\.g|i\.e|et al|Eq|Eqs|Sec|Fig|No|cf|vol|pp|p|approx|Prof|resp)\.")
COMMENT = re.compile(r"(?:^|\s)# (?!type:|fmt:|noqa|mypy:)(.*)")
ARGUMENT = re.compile(r"^\*{0,2}\w+: ")
SENTENCE = re.compile(r"(?<=[.?!:])\s+(?=[\"*(`[]*(?:[A-Z`]|orientd\b))")
LIST = re.compile(r"\s*(?:[-*|] |\d+\. |\.\. |@|#+ |\*{0,2}\w[\w, *./]*: )")

Text = tuple[int, str]


def paragraphs(text: str, first_line: int) -> Iterator[Text]:
    """Yield the paragraphs, entries of lists and table cells of a text, without code."""
    kept: list[str] = []
    start, is_code, block = first_line, False, -1
    for number, line in enumerate([*text.splitlines(), ""], first_line):
        indent = len(line) - len(line.lstrip())
        block = block if not line.strip() or indent > block else -1
        fence = line.lstrip().startswith(("```", ":::", ">>>", "\\[", "$$")) or block >= 0
        fence = fence or re.search(r"\w {3,}\w", line) is not None  # a table
        if not line.strip() or fence or is_code or LIST.match(line):
            if kept:
                yield start, " ".join(kept)
            kept = []
        if line.lstrip().startswith(("```", "$$")):
            is_code = not is_code
        if re.match(r"\s*\.\. (math|code-block)", line):
            fence, block = True, indent
        if is_code or fence or not line.strip() or line.lstrip().startswith("..."):
            continue
        if line.lstrip().startswith("|"):
            yield from ((number, cell.strip()) for cell in line.strip().strip("|").split("|"))
            continue
        if not kept:
            start = number
        kept.append(line.strip())


def python(path: Path) -> Iterator[Text]:
    """Yield the docstrings, comments, help and error texts of a module."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        match node:
            case ast.Expr(value=ast.Constant(value=str() as text)):
                yield from paragraphs(text, node.lineno)
            case ast.Raise() | ast.keyword(arg="help"):
                for one in ast.walk(node):
                    if isinstance(one, ast.Constant) and isinstance(one.value, str):
                        yield one.lineno, one.value
    yield from comments(path)


def comments(path: Path) -> Iterator[Text]:
    """Yield the comments of a module or of a file of settings."""
    block: list[str] = []
    start = 0
    for number, line in enumerate([*path.read_text(encoding="utf-8").splitlines(), ""], 1):
        found = COMMENT.search(line)
        if block and not (found and line.lstrip().startswith("#")):
            yield from paragraphs("\n".join(block), start)
            block = []
        if found:
            start = start if block else number
            block.append(found[1])


def c(path: Path) -> Iterator[Text]:
    source = path.read_text(encoding="utf-8")
    for found in re.finditer(r"/\*(.*?)\*/", source, re.DOTALL):
        yield from paragraphs(found[1], source.count("\n", 0, found.start()) + 1)


def markdown(path: Path) -> Iterator[Text]:
    text = path.read_text(encoding="utf-8")
    if path.name == "CHANGELOG.md":
        text = text[: text.find("\n## ", text.find("\n## ") + 1)]
    yield from paragraphs(text, 1)


READERS = {".py": python, ".c": c, ".h": c, ".md": markdown, ".toml": comments, ".yaml": comments}


def faults(path: Path) -> Iterator[Text]:
    """Yield what a file's prose should say otherwise, with the line."""
    for line, text in READERS[path.suffix](path):
        for sentence in re.split(SENTENCE, ABBREVIATION.sub("", text)):
            words = ARGUMENT.sub("", CODE.sub("X", sentence))
            for pattern, better in WORDS.items():
                if found := pattern.search(words):
                    yield line, f"{found[0]!r}: {better}"
            if CLAUSE.match(words):
                yield line, f"'{words[:30]}...': begin with the subject"
            if (count := len(re.findall(r"[^\W\d_]{2,}", words))) > MOST_WORDS:
                yield line, f"'{words[:30]}...': {count} words, at most {MOST_WORDS}"
            if ";" in words and path.suffix == ".md" and words.endswith((".", ":")):
                yield line, f"'{words[:30]}...': a semicolon, write two sentences"


def files() -> Iterator[Path]:
    """Yield what people read: sources, pages and settings, without tests and generated code."""
    for name in subprocess.check_output(["git", "ls-files"], cwd=ROOT, text=True).splitlines():
        path = ROOT / name
        if path.suffix in READERS and not re.search(r"_pb2|DECISION|^(\.|tests/)", name):
            yield from [path] * path.exists()


def folder(path: Path) -> str:
    parts = path.relative_to(ROOT).parts
    return "/".join(parts[: min(2, len(parts) - 1)]) or "."


def main() -> None:
    found = [(path, line, fault) for path in files() for line, fault in faults(path)]
    if len(sys.argv) > 1:
        below = Path(sys.argv[1]).resolve()
        for path, line, fault in found:
            if path.is_relative_to(below):
                print(f"{path.relative_to(ROOT)}:{line}: {fault}")
        return
    counts, left = Counter(folder(path) for path, _, _ in found), RULES["left"]
    more = [one for one in sorted(counts) if counts[one] > left.get(one, 0)]
    for one in more:
        print(f"{one}: {counts[one]} findings, {left.get(one, 0)} allowed by tests/prose.toml")
    sys.exit(bool(more))


if __name__ == "__main__":
    main()
