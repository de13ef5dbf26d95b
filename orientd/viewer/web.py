"""The web server of the pages: where it may listen, and who may talk to it.

The pages can stop a robot, and more, so a connection is taken only from a page that was served
here.
"""

from __future__ import annotations

import contextlib
import errno
import io
import logging
import socket
from typing import Any

import viser
from viser import _messages

from orientd.errors import DaemonError
from orientd.viewer.own_page import is_loopback, is_own_page

TITLE = "orientd"

_LONG_TEXT = 8.0
"""s that a refusal stays on the page."""


class _ForeignPageError(Exception):
    """A page from elsewhere wants to talk."""


def serve(host: str, port: int) -> viser.ViserServer:
    """Serve pages, which are empty as yet.

    Args:
        host: a name or an address of this machine.
        port: where to listen; 0 for any.

    Raises:
        DaemonError: the port is in use, or the address not one of this machine's.
    """
    # The library takes the next port that is free, whoever expects this one.
    _check_free(host, port)
    # It reports every handshake that is refused with a traceback, and greets on standard output.
    logging.getLogger("websockets.server").setLevel(logging.CRITICAL)
    with contextlib.redirect_stdout(io.StringIO()):
        server = viser.ViserServer(host=host, port=port, label=TITLE, verbose=False)
    if port not in (0, server.get_port()):
        stop(server)
        raise DaemonError(_in_use(host, port))
    _refuse_foreign_pages(server, is_local=is_loopback(host))
    dress(server, is_dark=False)
    # A browser without a graphics card draws nothing for ten seconds while it makes the lights that
    # surfaces reflect, and shadows again with every picture.
    server.scene.configure_default_lights(cast_shadow=False)
    server.scene.configure_environment_map(None)
    server.scene.add_light_ambient("/light", intensity=2.0)
    # What it calls sharing shows the pages to everybody, by way of a machine of somebody else's.
    infra = server._websock_server  # noqa: SLF001 - there is no other way
    infra.unregister_handler(_messages.ShareUrlRequest)
    return server


def dress(whose: viser.ViserServer | viser.ClientHandle, *, is_dark: bool) -> None:
    """Set how pages look: all of them, or those of one browser."""
    whose.gui.configure_theme(
        dark_mode=is_dark, show_logo=False, show_share_button=False, control_width="large"
    )


def set_changed(handle: Any, **properties: object) -> None:  # noqa: ANN401 - the library's own
    """Set what has changed of something on the page: every setting is sent to every page."""
    for name, value in properties.items():
        if getattr(handle, name) != value:
            setattr(handle, name, value)


def complain(event: Any, title: str, problem: str) -> None:  # noqa: ANN401 - the library's own
    """Tell whoever pressed a button what came of it, unless it was no browser."""
    if event.client is not None:
        event.client.add_notification(title, problem, color="red", auto_close_seconds=_LONG_TEXT)


def stop(server: viser.ViserServer) -> None:
    """End a server and what it has begun."""
    with contextlib.redirect_stdout(io.StringIO()):
        server.stop()


def _check_free(host: str, port: int) -> None:
    try:
        found = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE)
        for family, kind, protocol, _, address in found:
            with socket.socket(family, kind, protocol) as probe:
                probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
                probe.bind(address)
    except socket.gaierror as error:
        raise DaemonError(f"cannot serve at {host!r}: {error.strerror}") from error
    except PermissionError as error:
        raise DaemonError(f"cannot serve at {host} port {port}: {error.strerror}") from error
    except OSError as error:
        is_taken = error.errno == errno.EADDRINUSE
        problem = _in_use(host, port) if is_taken else f"cannot serve at {host}: {error.strerror}"
        raise DaemonError(problem) from error


def _in_use(host: str, port: int) -> str:
    return f"cannot serve at {host}: port {port} is in use; choose another with --port"


def _refuse_foreign_pages(server: viser.ViserServer, *, is_local: bool) -> None:
    infra = server._websock_server  # noqa: SLF001 - the library has no check of its own

    def check(client: viser.infra.WebsockClientConnection) -> None:
        request = infra._live_connections[client.client_id].request  # noqa: SLF001
        if request is None or not is_own_page(request.headers, is_local=is_local):
            # Whatever is raised here ends the connection before anything is read from it.
            raise _ForeignPageError

    infra.on_client_connect(check)
