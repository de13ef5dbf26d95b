"""The daemon: a gRPC server on a Unix domain socket, from its start to its orderly end."""

from __future__ import annotations

import asyncio
import logging
import os
import signal
import time
from collections.abc import Callable
from pathlib import Path

import grpc
from grpc_health.v1 import health, health_pb2, health_pb2_grpc
from grpc_reflection.v1alpha import reflection

import orientd
from orientd.config import Settings
from orientd.daemon.cell import Cell
from orientd.daemon.claim import claimed
from orientd.daemon.notify import notify
from orientd.daemon.service import ControlService
from orientd.errors import DaemonError
from orientd.rpc import control_pb2
from orientd.rpc.address import MAX_MESSAGE_BYTES, target
from orientd.rpc.control_pb2_grpc import add_ControlServicer_to_server
from orientd.rpc.reports import DaemonReport

_log = logging.getLogger(__name__)

SERVICE = control_pb2.DESCRIPTOR.services_by_name["Control"].full_name

READY_TIMEOUT = 15.0
"""How long devices may take to be ready before the daemon says what is wrong with them, s."""

GRACE = 1.0
"""How long calls may take to end once everything stands still, s."""

_LEASE_CHECKS = 0.02  # s between looks at whether the lease has run out

_OPTIONS = (
    ("grpc.max_receive_message_length", MAX_MESSAGE_BYTES),
    ("grpc.max_send_message_length", MAX_MESSAGE_BYTES),
    ("grpc.keepalive_time_ms", 10_000),
    ("grpc.keepalive_timeout_ms", 5_000),
    ("grpc.http2.min_recv_ping_interval_without_data_ms", 5_000),
    ("grpc.so_reuseport", 0),
)


def run(
    settings: Settings,
    *,
    socket: Path,
    configuration: str = "",
    on_ready: Callable[[DaemonReport, list[str]], None],
) -> None:
    """Be the daemon until SIGTERM or SIGINT.

    Args:
        settings: devices and lease.
        socket: where to listen.
        configuration: where the settings are from, for those who ask.
        on_ready: called once commands are taken, with what is wrong with the devices, if anything.

    Raises:
        ConfigError: a device of the settings is not possible here.
        DaemonError: there is a daemon at *socket* already, or it cannot be listened at.
    """
    address = target(socket)
    cell = Cell(settings)
    with claimed(socket):
        daemon = _Daemon(cell, socket, configuration)
        asyncio.run(daemon.run(address, on_ready))


class _Daemon:
    def __init__(self, cell: Cell, socket: Path, configuration: str) -> None:
        self._cell = cell
        self._socket = socket
        self._configuration = configuration
        self._started = time.monotonic()
        self._stopping = asyncio.Event()

    def describe(self) -> DaemonReport:
        """Return what there is to say about the daemon itself."""
        desk = self._cell.desk
        lease = desk.current()
        return DaemonReport(
            version=orientd.__version__,
            pid=os.getpid(),
            uptime=time.monotonic() - self._started,
            socket=str(self._socket),
            configuration=self._configuration,
            lease_holder=lease.holder if lease else "",
            lease_remaining=desk.remaining(lease) if lease else 0.0,
        )

    async def run(self, address: str, on_ready: Callable[[DaemonReport, list[str]], None]) -> None:
        """Serve until told to stop, then bring everything to rest."""
        loop = asyncio.get_running_loop()
        for number in (signal.SIGTERM, signal.SIGINT):
            loop.add_signal_handler(number, self._stop, number)
        service = ControlService(self._cell, self.describe)
        checks = health.aio.HealthServicer()  # type: ignore[attr-defined] # not in the stubs
        server = _server(service, checks)
        expiry = asyncio.create_task(self._expire_leases())
        try:
            # The servo processes come up while the server does.
            self._cell.launch()
            _bind(server, address, self._socket)
            await server.start()
            for name in ("", SERVICE):
                await checks.set(name, health_pb2.HealthCheckResponse.SERVING)
            await self._announce(on_ready)
            await self._stopping.wait()
            notify("STOPPING=1")
        finally:
            await checks.enter_graceful_shutdown()
            await asyncio.to_thread(self._cell.shutdown, "the daemon is going down")
            expiry.cancel()
            service.end_watches()
            await server.stop(GRACE)
            service.close()
            _log.info("daemon: ended")

    async def _announce(self, on_ready: Callable[[DaemonReport, list[str]], None]) -> None:
        """Say that the daemon is ready once its devices are, or have failed to be."""
        problems = await asyncio.to_thread(
            self._cell.wait_ready, READY_TIMEOUT, is_cancelled=self._stopping.is_set
        )
        if self._stopping.is_set():
            return
        for problem in problems:
            _log.error("%s", problem)
        on_ready(self.describe(), problems)
        notify("READY=1")

    async def _expire_leases(self) -> None:
        while True:
            await asyncio.sleep(_LEASE_CHECKS)
            if self._cell.desk.has_expired:
                await asyncio.to_thread(self._cell.expire)

    def _stop(self, number: int) -> None:
        name = signal.Signals(number).name
        if self._stopping.is_set():
            _log.warning("daemon: %s: already stopping, the devices come to rest first", name)
            return
        _log.info("daemon: %s: stopping", name)
        self._stopping.set()


def _server(service: ControlService, checks: health_pb2_grpc.HealthServicer) -> grpc.aio.Server:
    server = grpc.aio.server(options=_OPTIONS)
    add_ControlServicer_to_server(service, server)  # type: ignore[no-untyped-call] # generated
    health_pb2_grpc.add_HealthServicer_to_server(checks, server)
    names = (SERVICE, health.SERVICE_NAME, reflection.SERVICE_NAME)
    reflection.enable_server_reflection(names, server)
    return server


def _bind(server: grpc.aio.Server, address: str, socket: Path) -> None:
    """Listen at *address*, for the user alone."""
    before = os.umask(0o177)
    try:
        server.add_insecure_port(address)
    except RuntimeError as error:
        raise DaemonError(f"cannot listen at {socket}: {error}") from error
    finally:
        os.umask(before)
    socket.chmod(0o600)
