"""`orientd view`: commanded and measured motion of devices, live in a browser."""

from __future__ import annotations

import contextlib
import os
import threading
import webbrowser
from typing import Annotated, Protocol

from orientd.cli.command import Beside, Endpoint, Host, Port, need_extra
from orientd.cli.output import Output
from orientd.cli.parameters import Option

PORT = 8080

NoOpen = Annotated[bool, Option("--no-open", help="Do not open a browser.")]
Dark = Annotated[bool, Option("--dark", help="Use dark colours.")]


def view(
    at: Endpoint,
    out: Output,
    port: Port = PORT,
    host: Host = "127.0.0.1",
    control: Annotated[
        bool | None,
        Option(
            "--control/--no-control",
            help="Let pages do more than stop and halt; default: only on this machine.",
        ),
    ] = None,
    no_open: NoOpen = False,
    dark: Dark = False,
    lease: Beside = False,
) -> None:
    """Show a daemon's devices in the browser, until Ctrl-C or SIGTERM.

    Prints a line that begins with "ready" and contains the address. Everyone who can open the page
    can stop devices.  Users who take the lease there can also pause, slow down and reset
    them.
    """
    need_extra("view")
    from orientd.own_socket import is_loopback
    from orientd.viewer.view import View

    page = View(
        lambda: at.connect("view"),
        host=host,
        port=port,
        may_command=is_loopback(host) if control is None else control,
        is_dark=dark,
        is_beside=lease,
    )
    serve_page(page, host, no_open=no_open, out=out)


class Page(Protocol):
    """A page that a command serves.

    Attributes:
        port: TCP port of its server.
    """

    port: int

    def run(self, closing: threading.Event) -> None:
        """Serve until *closing* is set."""


def serve_page(page: Page, host: str, *, no_open: bool, out: Output) -> None:
    """Serve a page until Ctrl-C or SIGTERM, and open it in a browser if there is one."""
    url = f"http://{f'[{host}]' if ':' in host else host}:{page.port}"
    with contextlib.suppress(KeyboardInterrupt):
        out.answer({"ready": True, "url": url}, f"ready at {url}")
        # Without a display, a browser of the terminal would take over the terminal.
        if not no_open and {"DISPLAY", "WAYLAND_DISPLAY"} & set(os.environ):
            webbrowser.open(url)
        page.run(threading.Event())
