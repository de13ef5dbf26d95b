"""What somebody at a terminal sees while a command calculates; elsewhere, nothing.

It goes to standard error, so that standard output carries what was asked for and nothing else.
"""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Iterator, Sequence
from typing import TypeVar

Item = TypeVar("Item")


def counted(title: str, items: Sequence[Item], *, is_silent: bool = False) -> Iterator[Item]:
    """Yield *items*, with a bar of how many of them are done."""
    if is_silent or not sys.stderr.isatty():
        yield from items
        return
    # Rich takes its time to import, and most commands have no use for it.
    from rich.console import Console
    from rich.progress import track

    yield from track(items, description=title, console=Console(stderr=True), transient=True)


@contextlib.contextmanager
def working(title: str, *, is_silent: bool = False) -> Iterator[None]:
    """Say what is being done while the context lasts."""
    if is_silent or not sys.stderr.isatty():
        yield
        return
    from rich.console import Console
    from rich.text import Text

    with Console(stderr=True).status(Text(title)):
        yield
