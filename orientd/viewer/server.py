"""Serves one page and talks with every browser that shows it.

The page and its WebSocket share one port.  Any web page can make a browser connect to this machine,
and the page can stop a robot and more.  So a connection must come from a page that was served here.
"""

from __future__ import annotations

import asyncio
import json
import logging
import threading
from collections.abc import Mapping
from concurrent.futures import Executor, ThreadPoolExecutor
from http import HTTPStatus
from pathlib import Path
from typing import Any, Protocol

from websockets.asyncio.server import ServerConnection, serve
from websockets.datastructures import Headers
from websockets.exceptions import ConnectionClosed
from websockets.http11 import Request, Response

from orientd.errors import OrientdError
from orientd.own_socket import MOST_CLIENTS, is_loopback, is_own_page, own_socket

FRAMES_HZ = 30.0
MOST_BYTES = 2**16
"""The largest request."""

URGENT = ("stop", "halt")
"""Requests that are always answered: with ``answered``, and ``refused`` if they failed."""
_STOPPERS = 4
"""Threads that do nothing but stop."""


# The library reports every browser that hangs up early with a traceback.
_log = logging.getLogger(__name__)
_log.disabled = True


class Source(Protocol):
    """A page's content, and its requests."""

    def picture(self, seen: dict[str, Any]) -> dict[str, Any]:
        """Return everything that the page shows, by name; *seen* is the state of one browser."""

    def do(self, request: Mapping[str, Any]) -> None:
        """Carry out a request.

        Raises:
            OrientdError: it was refused.
        """


class PageServer:
    """Serve pages in a separate thread.

    Attributes:
        port: TCP port of the server.
        pages: how many are open.
    """

    def __init__(self, host: str, port: int, source: Source) -> None:
        """Serve the page at *host* and *port*; 0 for any port.

        Raises:
            DaemonError: the port is in use, or the address is not one of this machine.
        """
        self._source, self._is_local = source, is_loopback(host)
        self._socket = own_socket(host, port)
        self.port: int = self._socket.getsockname()[1]
        self.pages = 0
        self._page = Path(__file__).with_name("page.html").read_bytes()
        self._stoppers = ThreadPoolExecutor(_STOPPERS, thread_name_prefix="stop")
        self._loop = asyncio.new_event_loop()
        self._ending = asyncio.Event()
        self._thread = threading.Thread(target=self._run, name="pages", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Hang up on every browser."""
        self._loop.call_soon_threadsafe(self._ending.set)
        self._thread.join()
        self._stoppers.shutdown(wait=False)

    def _run(self) -> None:
        with asyncio.Runner(loop_factory=lambda: self._loop) as runner:
            runner.run(self._serve())

    async def _serve(self) -> None:
        async with serve(
            self._talk, sock=self._socket, process_request=self._respond,
            max_size=MOST_BYTES, compression=None, close_timeout=1.0, logger=_log,
        ):  # fmt: skip
            await self._ending.wait()

    def _respond(self, _: ServerConnection, request: Request) -> Response | None:
        """Answer a plain request with the page, and refuse connections of pages from elsewhere."""
        origin, host = request.headers.get("Origin"), request.headers.get("Host", "")
        if not is_own_page(origin, host, is_local=self._is_local):
            return _response(HTTPStatus.FORBIDDEN, "text/plain", b"not a page of this view\n")
        if "Upgrade" in request.headers:
            if self.pages < MOST_CLIENTS:
                return None
            return _response(HTTPStatus.SERVICE_UNAVAILABLE, "text/plain", b"too many pages\n")
        if request.path.partition("?")[0] != "/":
            return _response(HTTPStatus.NOT_FOUND, "text/plain", b"there is one page: /\n")
        return _response(HTTPStatus.OK, "text/html; charset=utf-8", self._page)

    async def _talk(self, connection: ServerConnection) -> None:
        self.pages += 1
        tasks = {asyncio.create_task(self._show(connection))}
        try:
            async for message in connection:
                task = asyncio.create_task(self._answer(connection, message))
                tasks.add(task)
                task.add_done_callback(tasks.discard)
        finally:
            self.pages -= 1
            for task in tasks:
                task.cancel()

    async def _show(self, connection: ServerConnection) -> None:
        """Send what has changed, as often as the browser takes it."""
        seen: dict[str, Any] = {}
        while True:
            picture = self._source.picture(seen)
            news = {key: value for key, value in picture.items() if seen.get(key, self) != value}
            seen |= news
            try:
                await connection.send(json.dumps(news, allow_nan=False))
            except ConnectionClosed:
                return
            await asyncio.sleep(1.0 / FRAMES_HZ)

    async def _answer(self, connection: ServerConnection, message: str | bytes) -> None:
        try:
            request = json.loads(message)
            worker: Executor | None = self._stoppers if request["do"] in URGENT else None
        except (ValueError, KeyError, TypeError):
            return
        answer: dict[str, str] = {}
        try:
            await self._loop.run_in_executor(worker, self._source.do, request)
        except OrientdError as error:
            answer["refused"] = str(error)
        except (KeyError, TypeError, ValueError):
            answer["refused"] = "the request makes no sense"
        if worker is not None:
            # A page that hears nothing says so: silence never counts as stopped.
            answer["answered"] = request["do"]
        if answer:
            await connection.send(json.dumps(answer))


def _response(status: HTTPStatus, kind: str, body: bytes) -> Response:
    headers = Headers({
        "Content-Type": kind,
        "Content-Length": str(len(body)),
        "Content-Security-Policy": "default-src 'none'; style-src 'unsafe-inline'; "
        "script-src 'unsafe-inline'; connect-src 'self' ws:; frame-ancestors 'none'",
        "Cache-Control": "no-store",
        "Connection": "close",
    })  # fmt: skip
    return Response(status.value, status.phrase, headers, body)
