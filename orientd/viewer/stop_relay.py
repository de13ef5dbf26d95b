"""Stops from the page, by a process of their own: the one of the page draws, and may hang.

Each page keeps a connection to it, by which a stop goes out the moment its button is pressed, and
on to the process that takes stops on this machine.  Where that is not answered, or refused, the
button stops by way of the page's own process, which says what came of it.
"""

from __future__ import annotations

import asyncio
import contextlib
import http
import json
import logging
import socket
import subprocess
import sys
from collections.abc import Mapping
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING

from orientd import first_stop
from orientd.errors import OrientdError
from orientd.viewer.own_page import is_loopback, is_own_page

if TYPE_CHECKING:
    from websockets.asyncio.server import ServerConnection
    from websockets.http11 import Request, Response

PRIORITY = 75
"""Of the process, where that is permitted; servos, at 80, still go first."""

_DONE = "done"
_LONGEST_WORD = 16
_PATIENCE = 500
"""How long an answer is waited for, ms, before the button's own way is taken."""

_ENDING = 2.0
"""How long the process takes to end by itself before it is ended, s."""


class StopRelay:
    """The process, for as long as the page is served.

    Attributes:
        port: that it listens at.
        html: for an element of the page, once: has its buttons stop by this way.
    """

    def __init__(self, host: str, page_port: int, daemon: Path, kinds: Mapping[str, str]) -> None:
        """Start the process.

        Args:
            host: where pages are served.
            page_port: at which port.
            daemon: its socket.
            kinds: of stops, by what is written on their buttons.
        """
        family, _, _, _, address = socket.getaddrinfo(host, 0, type=socket.SOCK_STREAM)[0]
        with socket.socket(family) as listener:
            listener.bind(address)
            listener.listen()
            self.port: int = listener.getsockname()[1]
            whose = [str(listener.fileno()), str(page_port), str(daemon.absolute())]
            self._process = subprocess.Popen(
                [sys.executable, "-m", __name__, *whose, *["--local"] * is_loopback(host)],
                stdin=subprocess.PIPE,
                pass_fds=[listener.fileno()],
            )
        script = _SCRIPT
        told = {"PORT": self.port, "KINDS": dict(kinds), "DONE": _DONE, "PATIENCE": _PATIENCE}
        for name, value in told.items():
            script = script.replace(name, json.dumps(value))
        self.html = f'<style onload="{escape(script)}"></style>'

    def close(self) -> None:
        """End the process."""
        if self._process.stdin is not None:
            self._process.stdin.close()
        try:
            self._process.wait(_ENDING)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()


# As in `drop`: an element's own event is what runs a script of a page that is put in as HTML.
_SCRIPT = """
window.stopPort = PORT;  // another one where the view was started again
if (!window.stopsAtOnce) {
  window.stopsAtOnce = true;
  const kinds = KINDS, unanswered = [];
  let way = null, isOwn = false;
  // What this way did not do is done by the button's own.
  const fall = () => {
    const {button, timer} = unanswered.shift();
    clearTimeout(timer);
    isOwn = true;
    button.click();
    isOwn = false;
  };
  const open = () => {
    try {
      way = new WebSocket(`ws://${location.hostname}:${stopPort}`);
      way.onclose = () => setTimeout(open, 1000);
      way.onmessage = ({data}) => {
        if (unanswered.length === 0) return;
        if (data === DONE) clearTimeout(unanswered.shift().timer); else fall();
      };
    } catch { way = null; }
  };
  open();
  document.addEventListener('click', event => {
    const button = event.target.closest('button');
    const kind = button && kinds[button.textContent.trim()];
    if (isOwn || !kind || !way || way.readyState !== WebSocket.OPEN) return;
    way.send(kind);
    event.stopImmediatePropagation();
    unanswered.push({button, timer: setTimeout(fall, PATIENCE)});
  }, true);
}
"""


def main() -> None:
    """Be the process until nobody holds the other end of its standard input."""
    from orientd.servo import set_scheduling

    descriptor, port, daemon, *others = sys.argv[1:]
    set_scheduling(PRIORITY)
    with contextlib.suppress(KeyboardInterrupt):  # the page's own process goes on to end this one
        asyncio.run(_serve(int(descriptor), int(port), daemon, is_local=bool(others)))


async def _serve(descriptor: int, port: int, daemon: str, *, is_local: bool) -> None:
    from websockets.asyncio.server import serve

    def check(connection: ServerConnection, request: Request) -> Response | None:
        if is_own_page(request.headers, is_local=is_local, port=port):
            return None
        return connection.respond(http.HTTPStatus.FORBIDDEN, "not a page of this view\n")

    async def take(connection: ServerConnection) -> None:
        async for kind in connection:
            if kind in first_stop.KINDS:
                await connection.send(await asyncio.to_thread(_outcome, daemon, str(kind)))

    ended = asyncio.Event()
    asyncio.get_running_loop().add_reader(0, ended.set)
    quiet = logging.getLogger(__name__)
    quiet.disabled = True
    listener = socket.socket(fileno=descriptor)
    async with serve(
        take, sock=listener, process_request=check, max_size=_LONGEST_WORD, compression=None,
        ping_interval=None, close_timeout=0.1, logger=quiet,
    ):  # fmt: skip
        await ended.wait()


def _outcome(daemon: str, kind: str) -> str:
    """Send a stop; return what the page is told of it."""
    try:
        answers = first_stop.send(daemon, kind)
        from orientd.rpc import ask_to_stop

        told = answers and ask_to_stop(Path(daemon), kind, answers=answers)
    except (OSError, OrientdError):
        told = None
    return _DONE if told else ""


if __name__ == "__main__":
    main()
