"""Find commands and readers of installed packages, by groups of entry points.

``orientd.commands``: each yields a :class:`click.Command`.  A dot stands for the space of the
command line, so ``serve.rotctld`` is a command of the group ``serve``.

``orientd.recordings``: one that reads recordings of other programs, for `orientd plot`.  It yields
a function of a path and a topic, with the keyword ``partial`` for cut or damaged files.  The result
has the attributes ``topic``, ``times`` (s, shape ``(n,)``), ``q`` (orientations ``(w, x, y, z)``,
shape ``(n, 4)``), ``clock`` (what the times are) and ``notes`` (lines for the user).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from orientd.cli.parameters import ANYTHING, Group
from orientd.errors import OrientdError

if TYPE_CHECKING:
    from collections.abc import Callable
    from importlib.metadata import EntryPoint

GROUP = "orientd.commands"
RECORDINGS = "orientd.recordings"


class OpenGroup(Group):
    """A group with commands of its own, to which installed packages add others.

    They are looked for only if none of its own has the name: that takes longer than a stop.
    """

    @property
    def prefix(self) -> str:
        """Beginning of the names of its entry points."""
        return f"{self.name}."

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the names of the commands: the group's own, then those of packages."""
        own = super().list_commands(ctx)
        return own + [name for name in sorted(self._installed()) if name not in own]

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Return the command of that name, or ``None``."""
        if own := super().get_command(ctx, cmd_name):
            return own
        entry = self._installed().get(cmd_name)
        return None if entry is None else _load(entry)

    def _installed(self) -> dict[str, EntryPoint]:
        """Return the commands of packages by their names in this group."""
        from importlib.metadata import entry_points  # slow to load

        ours = (one for one in entry_points(group=GROUP) if one.name.startswith(self.prefix))
        by_rest = {one.name.removeprefix(self.prefix): one for one in ours}
        return {rest: one for rest, one in by_rest.items() if "." not in rest}


def recordings_reader() -> Callable[..., Any]:
    """Return the function that reads recordings of other programs.

    Raises:
        OrientdError: no installed package has one, or it cannot be loaded.
    """
    from importlib.metadata import entry_points

    for entry in entry_points(group=RECORDINGS):
        try:
            reader: Callable[..., Any] = entry.load()
        except Exception as error:
            raise OrientdError(
                f"cannot load {entry.value}, which reads recordings of other programs: {error}"
            ) from error
        return reader
    raise OrientdError(
        "no installed package reads recordings of other programs: pip install --force-reinstall "
        "'orientd-motion[record]'"
    )


def _load(entry: EntryPoint) -> click.Command:
    """Return the command of an entry point, or one that says why there is none."""
    try:
        found = entry.load()
    except Exception as error:  # noqa: BLE001 - whatever a package raises when it is imported
        return _failing(f"cannot load {entry.value}, the command {entry.name}: {error}")
    if isinstance(found, click.Command):
        return found
    return _failing(f"{entry.value} is no command: expected a click.Command, got {found!r}")


def _failing(problem: str) -> click.Command:
    def fail() -> None:
        raise OrientdError(problem)

    return click.Command(
        None, callback=fail, help=problem, context_settings=ANYTHING, add_help_option=False
    )
