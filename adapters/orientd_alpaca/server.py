"""Serve ASCOM Alpaca: HTTP for devices and management, UDP for discovery."""

from __future__ import annotations

import contextlib
import ipaddress
import json
import re
import socket
import threading
from collections.abc import Sequence
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any
from urllib.parse import unquote

import orientd
from orientd.errors import DaemonError
from orientd.own_socket import ClientListener, is_own_page, own_socket
from orientd_alpaca.device import AlpacaDevice, BadRequest, envelope, read_call

_QUESTION = b"alpacadiscovery1"

_MOST_BYTES = 65536
"""Longest body of a request."""

_PATIENCE = 60.0
"""Seconds until a silent connection is closed."""

_DEVICE = re.compile(r"/api/v1/([a-z]+)/([0-9]{1,10})/([a-z]+)")


class Alpaca:
    """A server of devices for Alpaca clients.

    Attributes:
        endpoint: address and port.
        is_local: whether only programs of this machine may connect.
    """

    def __init__(
        self, devices: Sequence[AlpacaDevice], *, host: str, port: int, discovery: int
    ) -> None:
        """Listen at *host* and *port*, and for discovery.

        Args:
            devices: at most one of each kind.
            host: an address of this machine.
            port: 0 for any.
            discovery: UDP port for discovery; 0 for none.

        Raises:
            DaemonError: a port is in use, or the address is not one of this machine.
        """
        self._devices = {device.kind.lower(): device for device in devices}
        self._management = {
            "/management/apiversions": [1],
            "/management/v1/description": {
                "ServerName": "orientd",
                "Manufacturer": "orientd",
                "ManufacturerVersion": orientd.__version__,
                "Location": socket.gethostname(),
            },
            "/management/v1/configureddevices": [
                {
                    "DeviceName": device.name,
                    "DeviceType": device.kind,
                    "DeviceNumber": 0,
                    "UniqueID": device.unique_id,
                }
                for device in devices
            ],
        }
        self._server = _Server(own_socket(host, port), self)
        host, port = self._server.socket.getsockname()[:2]
        self.endpoint = f"{host}:{port}"
        self.is_local = ipaddress.ip_address(host).is_loopback
        self._finder: socket.socket | None = None
        try:
            if discovery:
                self._finder = _shared_socket(discovery)
                thread = threading.Thread(target=self._answer_discovery, args=(self._finder, port))
                thread.daemon = True
                thread.start()
        except DaemonError:
            self._server.server_close()
            raise

    def serve(self) -> None:
        """Serve until the process is interrupted."""
        self._server.serve_forever()

    def close(self) -> None:
        """Accept no more clients; the others get errors once the device is at rest."""
        if self._finder is not None:
            self._finder.close()
        self._server.server_close()

    def answer(self, path: str, text: str, *, is_put: bool) -> dict[str, Any]:
        """Return the answer to a request.

        Args:
            path: of its address.
            text: its query, or its body if it is a PUT.
            is_put: whether it is a PUT rather than a GET.

        Raises:
            BadRequest: it is malformed, or what it names is not there.
        """
        call = read_call(is_put=is_put, text=text)
        if not is_put and path in self._management:
            return {**envelope(call.transaction), "Value": self._management[path]}
        found = _DEVICE.fullmatch(path)
        if found is None:
            raise BadRequest(f"expected /api/v1/KIND/NUMBER/MEMBER, got {path[:80]!r}")
        kind, place, member = found.groups()
        device = self._devices.get(kind)
        if device is None or int(place) != 0:
            raise BadRequest(f"there is no device {kind[:40]}/{place}")
        return device.answer(member, call)

    def page(self) -> str:
        """Return the page for people."""
        names = ", ".join(device.name for device in self._devices.values())
        return (
            "<!DOCTYPE html><title>orientd</title><h1>orientd</h1>"
            f"<p>Alpaca server of {names}. The options of <code>orientd serve alpaca</code> and "
            "the daemon's configuration are its settings.</p>"
        )

    def _answer_discovery(self, finder: socket.socket, port: int) -> None:
        """Answer questions for the port; only those of this machine if no other may connect."""
        found = json.dumps({"AlpacaPort": port}).encode()
        with contextlib.suppress(OSError):  # closed
            while True:
                question, sender = finder.recvfrom(1024)
                is_known = not self.is_local or ipaddress.ip_address(sender[0]).is_loopback
                if question.startswith(_QUESTION) and is_known:
                    with contextlib.suppress(OSError):
                        finder.sendto(found, sender)


def _shared_socket(port: int) -> socket.socket:
    """Return a UDP socket for broadcasts, which other Alpaca servers share.

    Raises:
        DaemonError: another program has the port for itself.
    """
    opened = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        opened.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        opened.bind(("", port))
    except OSError as error:
        opened.close()
        raise DaemonError(
            f"cannot answer discovery: UDP port {port} is in use; choose another with --discovery, "
            "or 0 for none"
        ) from error
    return opened


class _Server(ThreadingHTTPServer):
    """The HTTP server, with a thread for each connection."""

    def __init__(self, listener: socket.socket, alpaca: Alpaca) -> None:
        super().__init__(listener.getsockname(), _Handler, bind_and_activate=False)
        self.socket.close()
        self.socket, self._listener = listener, ClientListener(listener)
        self.alpaca = alpaca

    def get_request(self) -> tuple[socket.socket, Any]:
        """Return the next client; the library waits for another if there is none."""
        return self._listener.accept()

    def server_close(self) -> None:
        """Accept no more clients."""
        super().server_close()
        self._listener.close()

    def handle_error(self, request: Any, client_address: Any) -> None:  # noqa: ANN401 - as inherited
        """Take a client that hangs up as its end."""


class _Handler(BaseHTTPRequestHandler):
    """The conversation with a client."""

    server: _Server
    protocol_version = "HTTP/1.1"
    timeout = _PATIENCE
    disable_nagle_algorithm = True

    def do_GET(self) -> None:
        """Answer a GET."""
        path, _, query = self.path.partition("?")
        if not self._is_admitted():
            return
        if path.startswith("/setup") or path == "/":
            self._send(HTTPStatus.OK, "text/html", self.server.alpaca.page().encode())
            return
        self._answer(path, query, is_put=False)

    def do_PUT(self) -> None:
        """Answer a PUT."""
        length = self.headers.get("Content-Length", "0")
        if not length.isdecimal() or len(length) > 9 or int(length) > _MOST_BYTES:
            self.close_connection = True
            self._send(HTTPStatus.BAD_REQUEST, "text/plain", b"the body is too long")
            return
        body = self.rfile.read(int(length))
        if not self._is_admitted():
            return
        self._answer(self.path.partition("?")[0], body.decode("latin-1"), is_put=True)

    def _is_admitted(self) -> bool:
        """Return whether the server carries the request out; refuse it otherwise."""
        origin, host = self.headers.get("Origin"), self.headers.get("Host", "")
        if is_own_page(origin, host, is_local=self.server.alpaca.is_local):
            return True
        self.close_connection = True
        self._send(HTTPStatus.FORBIDDEN, "text/plain", b"the Host or the Origin is not this server")
        return False

    def _answer(self, path: str, text: str, *, is_put: bool) -> None:
        try:
            answer = self.server.alpaca.answer(unquote(path), text, is_put=is_put)
        except BadRequest as error:
            self._send(HTTPStatus.BAD_REQUEST, "text/plain", str(error).encode())
            return
        self._send(HTTPStatus.OK, "application/json", json.dumps(answer).encode())

    def _send(self, status: HTTPStatus, kind: str, body: bytes) -> None:
        self.send_response(status)
        self.send_header("Content-Type", f"{kind}; charset=utf-8")
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, format: str, *args: object) -> None:  # noqa: A002 - as inherited
        """Log nothing: the daemon logs every command."""
