"""Do what a page says, in a folder of its own."""

from __future__ import annotations

import contextlib
import os
import re
import select
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import matplotlib
from pages import OWN_TERMINAL, Block

PATIENCE = 300.0

_INSTALLED = """\
#!/bin/sh
case "$1 $2" in
"install .")
    exec {python} -m pip install --quiet --no-deps --no-build-isolation --target {site} .
    ;;
esac
"""
_PYTHON = """\
#!/bin/sh
case "$1 $2" in
"-m venv") mkdir -p "$3/bin" && : > "$3/bin/activate" ;;
*) exec {python} "$@" ;;
esac
"""


class Follower:
    """A reader of one page: a shell, terminals of their own, files.

    Attributes:
        folder: where the reader is.
        fresh: folder of the wheel for a reader who has nothing but Python and pip; ``None`` for
            one who has orientd, and for whom whatever a page installs is there.
    """

    def __init__(self, folder: Path, *, fresh: Path | None = None) -> None:
        self.folder = folder
        self.fresh = fresh
        self._terminals: list[subprocess.Popen[bytes]] = []
        self._printed = ""
        self._own = {
            "127.0.0.2": f"127.{os.getpid() % 200 + 20}.{os.getpid() // 200 % 250}.9",
            "/tmp/gimbal": str(folder / "line"),
            "/tmp/feetech": str(folder / "feetech"),
            "/tmp/setpoints.txt": str(folder / "setpoints.txt"),
            "9464": str(_free_port()),
            "8089": str(_free_port()),
        }
        kept = {k: v for k, v in os.environ.items() if not k.startswith(("ORIENTD_", "XDG_"))}
        self.environment = {
            **kept,
            "HOME": str(folder),
            "XDG_RUNTIME_DIR": str(folder),
            # Without it Matplotlib builds its font cache for every page, and prints a notice.
            "MPLCONFIGDIR": matplotlib.get_cachedir(),
            "PYTHONPATH": os.pathsep.join([str(folder / "site"), *sys.path]),
            "PATH": f"{folder / 'bin'}{os.pathsep}{os.environ['PATH']}",
        }
        if fresh is not None:
            self.environment["PATH"] = os.environ["PATH"]
            # The wheel in place of the clone that the page is read in: it is built once.
            self._own["install '.["] = "install 'orientd-motion["
            self.environment["PIP_FIND_LINKS"] = str(fresh)
            self.environment["PIP_DISABLE_PIP_VERSION_CHECK"] = "1"
            self.environment.pop("PYTHONPATH")
            self.environment.pop("MPLCONFIGDIR")
            return
        programs = folder / "bin"
        programs.mkdir()
        for name, text in {
            "orientd": '#!/bin/sh\nexec {python} -m orientd "$@"\n',
            "pip": _INSTALLED,
            "python": _PYTHON,
            "python3": _PYTHON,
        }.items():
            path = programs / name
            path.write_text(text.format(python=sys.executable, site=folder / "site"))
            path.chmod(0o755)
        activate = folder / "robot" / "bin" / "activate"
        activate.parent.mkdir(parents=True)
        activate.touch()

    def __enter__(self) -> Follower:
        return self

    def __exit__(self, *_: object) -> None:
        for terminal in reversed(self._terminals):
            with contextlib.suppress(ProcessLookupError):
                os.killpg(terminal.pid, signal.SIGTERM)
            try:
                terminal.wait(30.0)
            except subprocess.TimeoutExpired:
                os.killpg(terminal.pid, signal.SIGKILL)
                terminal.wait()
            terminal.stdout.close()

    def do(self, block: Block) -> None:
        """Do what a block says; what is wrong is an assertion with its place."""
        text = self._mine(block.text)
        if block.why_not:
            return
        if block.language == "text":
            self._compare(block.place, text)
        elif block.caption == OWN_TERMINAL:
            self._begin(block.place, text)
        elif block.caption:
            path = self.folder / block.caption
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text)
        elif block.language == "sh":
            self._printed = self._run(block.place, text)
        elif block.language == "python":
            (self.folder / "block.py").write_text(text)
            self._printed = self._run(block.place, "python block.py")

    def _mine(self, text: str) -> str:
        for theirs, mine in self._own.items():
            text = text.replace(theirs, mine)
        return text

    def _run(self, place: str, text: str) -> str:
        done = subprocess.run(
            # A command after theirs: the last one would be run in the shell's place, and no shell
            # be there for those who look which one they are in.
            ["bash", "-e", "-o", "pipefail", "-c", f"{self._activated(text)}\n:"],
            cwd=self.folder,
            env=self.environment,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            timeout=PATIENCE,
            check=False,
        )
        assert done.returncode == 0, f"{place}: {text}\n{done.stdout}"
        return done.stdout

    def _activated(self, text: str) -> str:
        """Return commands for the shell that the reader has left the environment active in."""
        activate = self.folder / "robot" / "bin" / "activate"
        return f". {activate}\n{text}" if self.fresh is not None and activate.exists() else text

    def _begin(self, place: str, text: str) -> None:
        with (self.folder / "log").open("ab") as log:
            process = subprocess.Popen(
                ["bash", "-e", "-c", self._activated(text)],
                cwd=self.folder,
                env=self.environment,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=log,
                process_group=0,
            )
        self._terminals.append(process)
        said, end = b"", time.monotonic() + PATIENCE
        while b"ready" not in said:
            readable, _, _ = select.select([process.stdout], [], [], end - time.monotonic())
            more = os.read(process.stdout.fileno(), 4096) if readable else b""
            said += more
            assert more, f"{place}: not ready: {said!r} {(self.folder / 'log').read_text()}"

    def _compare(self, place: str, expected: str) -> None:
        pattern = ".*".join(re.escape(part) for part in _plain(expected).split("..."))
        found = _plain(self._printed)
        assert re.fullmatch(pattern, found, re.DOTALL), f"{place}: {found!r} is not {expected!r}"


def _plain(text: str) -> str:
    """Return *text* without what only lays it out."""
    return "\n".join(" ".join(line.split()) for line in text.strip().splitlines())


def _free_port() -> int:
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        port: int = one.getsockname()[1]
        return port
