"""Completion on the command line: the scripts for shells."""

from __future__ import annotations

import os
from pathlib import Path

import click
from click.shell_completion import get_completion_class

from orientd.errors import OrientdError

VARIABLE = "_ORIENTD_COMPLETE"
"""Environment variable with the shell's request."""

_PLACES = {
    "bash": (".bash_completions/orientd.sh", ".bashrc", "source ~/.bash_completions/orientd.sh"),
    "zsh": (".zfunc/_orientd", ".zshrc", "fpath+=~/.zfunc; autoload -Uz compinit; compinit"),
    "fish": (".config/fish/completions/orientd.fish", "", ""),
}
"""The script of each shell, and the file that needs a line for it; both below the home."""


def script(app: click.Command, shell: str = "") -> str:
    """Return the completion script of *app* for a shell.

    Args:
        app: the command `orientd`.
        shell: bash, zsh or fish; by default that of ``$SHELL``.

    Raises:
        OrientdError: the shell is not supported.
    """
    shell = shell or _shell()
    made = get_completion_class(shell)
    if made is None:
        raise OrientdError(f"$SHELL: expected one of {', '.join(_PLACES)}, got {shell!r}")
    return made(app, {}, "orientd", VARIABLE).source()


def install(app: click.Command) -> str:
    """Install the script for the shell of ``$SHELL``; return its place as text.

    Raises:
        OrientdError: the shell is not supported, or a file cannot be written.
    """
    text = script(app)
    place, start, line = _PLACES[_shell()]
    path, started = Path.home() / place, Path.home() / start
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
        if start and line not in (started.read_text("utf-8") if started.exists() else ""):
            with started.open("a", encoding="utf-8") as file:
                file.write(f"\n{line}\n")
    except OSError as error:
        raise OrientdError(f"cannot write {error.filename}: {error.strerror}") from error
    return f"wrote {path}; a new terminal completes"


def _shell() -> str:
    return Path(os.environ.get("SHELL", "")).name
