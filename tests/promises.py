"""Check that promises.toml is complete and that its tests exist.  Run by ``make check``.

::

    python tests/promises.py [FOLDER]

With the folder in which a run has noted the tests that passed, as ``make test`` does it, this says
by what the promises are held: by tests of this run, by tests that passed at night, or by nothing.
"""

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

AT_NIGHT = TESTS / "passed_at_night.toml"
"""When each test of a promise passed last in ``make night``."""

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


def tests_of_promise(tests: str | list[str]) -> list[str]:
    """Return the tests of one line."""
    return [tests] if isinstance(tests, str) else tests


def passed(folder: Path) -> frozenset[str]:
    """Return the tests that have passed, as a run has noted them in a folder."""
    notes = (one.read_text(encoding="utf-8") for one in folder.iterdir())
    return frozenset(line for note in notes for line in note.splitlines())


def held(promises: Mapping[str, Any], now: frozenset[str], at_night: Mapping[str, str]) -> str:
    """Return how many promises are held by tests that ran, and a line for each that is not."""
    counts, dates, unheld = 0, [], []
    for place, says, tests in places(promises):
        own = tests_of_promise(tests)
        if not now.isdisjoint(own):
            counts += 1
        elif nights := [at_night[test] for test in own if test in at_night]:
            dates.append(max(nights))
        else:
            unheld.append(f'{place}: "{says}" needs {" or ".join(own)}')
    since = f", since {min(dates)} or later" if dates else ""
    first = (
        f"promises: {counts} held by tests that passed now, "
        f"{len(dates)} by tests that passed at night{since}, {len(unheld)} by none"
    )
    return "\n".join([first, *unheld])


def missing_tests(promises: Mapping[str, Any]) -> Iterator[str]:
    """Yield tests that a promise names and that are not there."""
    for place, says, tests in places(promises):
        for test in tests_of_promise(tests):
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


def main(words: list[str]) -> int:
    """Check the ledger, or say by what its promises are held; return the exit status."""
    promises = tomllib.loads(FILE.read_text(encoding="utf-8"))
    if words:
        at_night = tomllib.loads(AT_NIGHT.read_text(encoding="utf-8"))
        print(held(promises, passed(Path(words[0])), at_night))
        return 0
    checks = (missing_tests, headings, command_line, kinds)
    problems = [problem for check in checks for problem in check(promises)]
    for problem in problems:
        print(f"promises.toml: {problem}")
    if not problems:
        print(f"{sum(1 for _ in places(promises))} promises with their tests")
    return 1 if problems else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
