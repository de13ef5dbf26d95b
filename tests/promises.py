"""Check that promises.toml is complete and that its tests exist.  Run by ``make check``."""

from __future__ import annotations

import ast
import functools
import re
import sys
import tomllib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import click

from orientd import errors
from orientd.cli.main import app

TESTS = Path(__file__).parent
ROOT = TESTS.parent
FILE = TESTS / "promises.toml"

PAGES = ("README.md", "SECURITY.md", "docs/explanation/*.md", "docs/how-to/*.md")
"""Pages of which each heading has a promise, or is among those that explain."""

INVARIANTS = 11
_MADE = "% Made from the code"
"""How a page begins that only a build of the documentation makes."""

_HEADING = re.compile(r"^## (.*)$", re.MULTILINE)


@functools.cache
def tests_of(file: str) -> frozenset[str]:
    """Return the names of the tests of a file, empty if there is no such file."""
    path = TESTS / file
    if not path.is_file():
        return frozenset()
    tree = ast.parse(path.read_text(encoding="utf-8"))
    return frozenset(one.name for one in ast.walk(tree) if isinstance(one, ast.FunctionDef))


def places(promises: Mapping[str, Any]) -> Iterator[tuple[str, str, Any]]:
    """Yield place, promise and tests of each line."""
    for table, inside in promises.items():
        for name, value in inside.items():
            if isinstance(value, dict):
                yield from ((f"{table}: {name}", says, tests) for says, tests in value.items())
            elif name != "explains" and table != "untested":
                yield table, name, value


def missing_tests(promises: Mapping[str, Any]) -> Iterator[str]:
    """Yield tests that a promise names and that are not there."""
    for place, says, tests in places(promises):
        for test in [tests] if isinstance(tests, str) else tests:
            file, _, name = test.partition("::")
            if name not in tests_of(file):
                yield f'{place}: "{says}" is held by {test}, which is not there'


def headings(promises: Mapping[str, Any]) -> Iterator[str]:
    """Yield headings without a promise, and promises of headings that are not there."""
    pages = {str(path.relative_to(ROOT)) for glob in PAGES for path in ROOT.glob(glob)}
    pages = {page for page in pages if Path(page).name not in {"index.md", "glossary.md"}}
    for page in sorted(pages):
        text = (ROOT / page).read_text(encoding="utf-8")
        if text.startswith(_MADE):
            continue
        text = re.sub(r"^ *```.*?^ *```$", "", text, flags=re.MULTILINE | re.DOTALL)
        on_page = {"", *_HEADING.findall(text)}
        lines = promises.get(page, {})
        held = {one for one, value in lines.items() if isinstance(value, dict)}
        explains = set(lines.get("explains", ()))
        yield from (f'{page} has no heading "{one}"' for one in sorted((held | explains) - on_page))
        yield from (
            f'{page}: "{one or "its beginning"}" has no promise and does not only explain'
            for one in sorted(on_page - held - explains)
        )
    for page in promises:
        if page.endswith(".md") and page not in pages:
            yield f"{page} is not there"


def options(group: Any, name: str = "") -> Iterator[tuple[str, tuple[str, ...]]]:
    """Yield each command with its options."""
    context = click.Context(group)
    for word in group.list_commands(context):
        command = group.get_command(context, word)
        if command.hidden:
            continue
        if isinstance(command, click.Group):
            yield from options(command, f"{name}{word} ")
            if not command.invoke_without_command:
                continue
        yield (
            f"{name}{word}",
            tuple(
                max(one.opts, key=len)
                for one in command.params
                if one.param_type_name == "option" and not one.hidden
            ),
        )


def command_line(promises: Mapping[str, Any]) -> Iterator[str]:
    """Yield commands and options without a test, and tests of commands that are not there."""
    held, untested = set(promises["commands"]), set(promises["untested"]["options"])
    known = {"--help", "--version"}
    for command, given in options(app):
        if command not in held:
            yield f"no test holds `orientd {command}`"
        own = {f"{command} {option}" for option in given}
        known |= {command, *own, *given}
        lacking = {one for one in own - held - untested if one.rpartition(" ")[2] not in held}
        yield from (f"no test holds `orientd {one}`" for one in sorted(lacking))
    listed = {one for one in held if not one.startswith("exit status")} | untested
    yield from (f"there is no `orientd {one}`" for one in sorted(listed - known))
    yield from (f"`orientd {one}` has a test" for one in sorted(held & untested))


def kinds(promises: Mapping[str, Any]) -> Iterator[str]:
    """Yield faults, errors and invariants without a test."""
    there = {
        "faults": {fault.name for fault in errors.Fault} - {"NONE"},
        "errors": {
            name
            for name, one in vars(errors).items()
            if isinstance(one, type) and issubclass(one, errors.OrientdError)
        },
        "invariants": {f"{number}." for number in range(1, INVARIANTS + 1)},
    }
    for table, names in there.items():
        held = {one.partition(" ")[0] for one in promises[table]}
        yield from (f"{table}: no test holds {one}" for one in sorted(names - held))


def main() -> int:
    promises = tomllib.loads(FILE.read_text(encoding="utf-8"))
    checks = (missing_tests, headings, command_line, kinds)
    problems = [problem for check in checks for problem in check(promises)]
    for problem in problems:
        sys.stdout.write(f"promises.toml: {problem}\n")
    if not problems:
        sys.stdout.write(f"{sum(1 for _ in places(promises))} promises with their tests\n")
    return 1 if problems else 0


if __name__ == "__main__":
    raise SystemExit(main())
