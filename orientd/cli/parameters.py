"""A command of Click from a function: each parameter of its signature is an option or an argument.

A parameter that is a dataclass, such as :class:`~orientd.cli.command.Commander`, has an option for
each of its fields.

>>> def greet(name: Annotated[str, Option(help="Who it is.")] = "you") -> None:
...     print(f"hello {name}")
>>> command_of(Command, greet).main(["--name", "Ana"], standalone_mode=False)
hello Ana
"""

from __future__ import annotations

import functools
import inspect
import math
from collections.abc import Callable
from dataclasses import fields, is_dataclass
from pathlib import Path
from types import NoneType
from typing import Annotated, Any, Literal, TypeVar, get_args, get_origin, get_type_hints

import click

from orientd.spelling import did_you_mean

Run = TypeVar("Run", bound=Callable[..., None])
Kind = TypeVar("Kind", bound=click.Command)

ANYTHING = {"allow_extra_args": True, "ignore_unknown_options": True}
"""Settings of a command that takes whatever comes and says what to do instead."""


class Group(click.Group):
    """A group of commands, in the order in which they were declared."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the names of the commands."""
        del ctx
        return list(self.commands)

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Return the command that *args* begin with, or refuse it with the nearest name."""
        name = args[0]
        is_word = not (name.startswith("-") or ctx.resilient_parsing)
        if is_word and self.get_command(ctx, name) is None:
            hint = did_you_mean(name, self.list_commands(ctx))
            raise click.UsageError(f"no such command {name!r}{hint}", ctx)
        return super().resolve_command(ctx, args)


class Command(click.Command):
    """A command whose help describes its arguments too."""

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the arguments, then the options."""
        rows = [vars(one)["row"] for one in self.params if "row" in vars(one)]
        if rows:
            with formatter.section("Positional arguments"):
                formatter.write_dl(rows)
        super().format_options(ctx, formatter)


class Option:
    """An option of a command.

    Attributes:
        names: as on the command line; by default that of the parameter, and ``--no-...`` of a flag.
        settings: of :class:`click.Option`, and ``range``, the least and the largest number.
    """

    def __init__(self, *names: str, **settings: Any) -> None:  # noqa: ANN401 - Click's
        self.names, self.settings = names, settings


class Argument(Option):
    """An argument of a command; *settings* are those of :class:`click.Argument`."""


AsJson = Annotated[bool, Option("--json", help="Print one JSON object.")]


def command_of(kind: type[Kind], run: Callable[..., None], **settings: Any) -> Kind:  # noqa: ANN401 - Click's
    """Return the command that calls *run*.

    Args:
        kind: :class:`Command`, or a group.
        run: its docstring is the help.  A parameter with a default need not be given.
        settings: of the class.
    """
    taken = inspect.signature(run, eval_str=True).parameters.values()
    bundles: dict[str, Any] = {
        one.name: one.annotation for one in taken if is_dataclass(one.annotation)
    }
    given = [(one.name, one.annotation, one.default) for one in taken if one.name not in bundles]
    for bundle in bundles.values():
        # The class of the output does without Click, which takes longer to load than a stop.
        hints = get_type_hints(bundle, include_extras=True) | {"as_json": AsJson}
        given += [(field.name, hints[field.name], field.default) for field in fields(bundle)]
    parameters = [_parameter(*one) for one in given]
    defaults = {name: default for name, _, default in given}
    repeatable = [one.name for one in parameters if one.multiple]

    @functools.wraps(run)
    def call(**values: Any) -> None:  # noqa: ANN401 - those of the command
        for name in repeatable:
            values[name] = list(values[name]) or defaults[name]
        for name, bundle in bundles.items():
            values[name] = bundle(**{one.name: values.pop(one.name) for one in fields(bundle)})
        run(**values)

    settings = {"name": run.__name__, "help": inspect.getdoc(run), **settings}
    return kind(params=parameters, callback=call, **settings)


def command(run: Callable[..., None]) -> click.Command:
    """Make the decorated function a command, for the group `orientd.commands` of entry points."""
    return command_of(Command, run)


def part_of(group: click.Group, **settings: Any) -> Callable[[Run], Run]:  # noqa: ANN401 - Click's
    """Make the decorated function a command of *group*."""

    def add(run: Run) -> Run:
        group.add_command(command_of(Command, run, **settings))
        return run

    return add


def _parameter(name: str, annotation: Any, default: Any) -> click.Parameter:  # noqa: ANN401 - any
    kind, said = get_args(annotation)
    # For an optional type, the type itself.
    kind = next((one for one in get_args(kind) if NoneType in get_args(kind)), kind)
    settings = dict(said.settings)
    limits = settings.pop("range", None)
    is_list = get_origin(kind) is list
    settings["type"] = _type(get_args(kind)[0] if is_list else kind, limits)
    settings["required"] = default is inspect.Parameter.empty
    if not settings["required"] and not is_list:
        settings["default"] = default
    if isinstance(said, Argument):
        if not settings["required"]:
            settings["metavar"] = f"[{settings['metavar']}]"
        # Click before 8.5 takes no description of an argument.
        description = settings.pop("help", "")
        argument = click.Argument([name], **settings)
        vars(argument)["row"] = (settings.get("metavar") or name.upper(), description)
        return argument
    spelt = name.replace("_", "-")
    flag = f"--{spelt}/--no-{spelt}" if kind is bool else f"--{spelt}"
    settings["is_flag"] = True if kind is bool else None  # False lets Click omit a value
    settings["multiple"] = is_list
    settings["show_default"] = default not in (None, "") and default is not False
    return click.Option([*(said.names or (flag,)), name], **settings)


class _FiniteRange(click.FloatRange):
    """Numbers in a range; Click's own accepts NaN, which no comparison excludes."""

    def convert(
        self,
        value: Any,  # noqa: ANN401 - Click's
        param: click.Parameter | None,
        ctx: click.Context | None,
    ) -> float:
        found: float = super().convert(value, param, ctx)
        if not math.isfinite(found):
            self.fail(f"expected a finite number, got {value}", param, ctx)
        return found


def _type(kind: Any, limits: tuple[Any, Any] | None) -> Any:  # noqa: ANN401 - Click's
    """Return the parser of *kind*, within *limits* for a number."""
    if limits is not None:
        return click.IntRange(*limits) if kind is int else _FiniteRange(*limits)
    if get_origin(kind) is Literal:
        return click.Choice(get_args(kind))
    # A file that cannot be read is no mistake of usage; whoever opens it says so.
    return click.Path(path_type=Path, readable=False) if kind is Path else kind
