"""The reference of the command line, from the commands themselves."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import click

from orientd.cli.main import app

_EXIT = """\
Every command has `--help`. The exit status is 0 after success, 1 after a failure or a refusal, and
2 after a usage error. Ctrl-C before a motion has begun gives 130, and SIGTERM 143. An error is one
line on standard error. With `--json`, results and errors are JSON objects.
"""


def pages(source: Path) -> Iterator[tuple[str, str]]:
    """Yield one page for each command, and one that lists them."""
    del source
    context = click.Context(app, info_name="orientd")
    listed, names = [], []
    for name in app.list_commands(context):
        command = app.get_command(context, name)
        text = f"# `orientd {name}`\n\n" + "\n".join(_command(command, context, name, level=2))
        yield f"reference/command-line/{name}.md", text
        listed.append(f"| [`orientd {name}`]({name}.md) | {_first(command)} |")
        names.append(name)
    table = ["| command | effect |", "|---|---|", *listed]
    yield (
        "reference/command-line/index.md",
        "\n".join(["# Command line", "", _EXIT, *table, "", *_contents(names)]),
    )


def _command(command: Any, above: Any, name: str, *, level: int) -> Iterator[str]:  # noqa: ANN401 - Click's
    context = click.Context(command, info_name=name, parent=above)
    if not command.help:
        raise ValueError(f"orientd {context.command_path} has no help")
    yield from (
        "```text",
        " ".join(command.get_usage(context).split()).replace("Usage: ", ""),
        "```",
        "",
    )
    yield from (_plain(command.help), "")
    rows = list(_rows(command, context))
    if rows:
        yield from ("| argument or option | meaning |", "|---|---|", *rows, "")
    for inner in command.list_commands(context) if isinstance(command, click.Group) else ():
        yield f"{'#' * level} `orientd {name} {inner}`\n"
        yield from _command(command.get_command(context, inner), context, inner, level=level + 1)


def _rows(command: Any, context: Any) -> Iterator[str]:  # noqa: ANN401 - Click's
    for parameter in command.get_params(context):
        if "--help" in parameter.opts or getattr(parameter, "hidden", False):
            continue
        record = getattr(parameter, "row", None) or parameter.get_help_record(context)
        if not record or not record[1].partition("[")[0].strip():
            raise ValueError(f"{context.command_path}: {parameter.name} has no help")
        yield f"| `{_cell(record[0])}` | {_cell(_plain(record[1]))} |"


def _first(command: Any) -> str:  # noqa: ANN401 - Click's
    return _cell(_plain(command.help).split("\n\n")[0])


def _plain(text: str) -> str:
    # A line that is all an example in JSON is shown as it is.
    parts = [part.replace("\n", " ").strip() for part in text.split("\n\n")]
    parts = [f"`{part}`" if part.startswith("{") else part for part in parts]
    return "\n\n".join(part.replace("<", "&lt;") if "`" not in part else part for part in parts)


def _cell(text: str) -> str:
    return text.replace("|", "\\|").replace("\n", " ")


def _contents(names: list[str]) -> list[str]:
    return ["```{toctree}", ":hidden:", "", *names, "```", ""]
