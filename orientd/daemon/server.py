"""The daemon: a gRPC server on a Unix domain socket, from its start to its orderly end."""

from __future__ import annotations

import asyncio
import contextlib
import ctypes
import gc
import logging
import os
import signal
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from grpclib.health.check import ServiceStatus

import orientd
from orientd import processor
from orientd.config import Settings
from orientd.daemon.access import (
    AuditLog,
    Authorization,
    Listener,
    audit_path,
    claimed,
)
from orientd.daemon.stops import StopFolder
from orientd.daemon.systemd import Watchdog, notify
from orientd.errors import ConfigError, DaemonError, OrientdError
from orientd.rpc import control_pb2, target

if TYPE_CHECKING:
    from orientd.daemon.calls import ControlService, Telemetry
    from orientd.daemon.cell import Cell
    from orientd.daemon.fleet import FleetLink

_log = logging.getLogger(__name__)

SERVICE = control_pb2.DESCRIPTOR.services_by_name["Control"].full_name

READY_TIMEOUT = 15.0
"""How long devices may take to be ready before the daemon says what is wrong with them, s."""

FIRST_PAUSE, LONGEST_PAUSE = 2.0, 60.0
"""How long a device that was not ready is left alone before it is started again, s."""

GRACE = 1.0
"""How long calls may take to end once everything stands still, s."""

_MALLOC = {-8: 2, -3: 2**16}
"""Of malloc.h: at most two heaps, and blocks of their own from 64 KiB on."""

_LEASE_CHECKS = 0.02  # s between looks at whether the lease has run out


def run(
    settings: Settings,
    *,
    socket: Path,
    configuration: str = "",
    reread: Callable[[], Settings] | None = None,
    on_ready: Callable[[control_pb2.DaemonReport, list[str]], None],
    needs_devices: bool = False,
) -> None:
    """Be the daemon until SIGTERM or SIGINT.

    A device that is not ready when the daemon is, is started again every now and then.

    Args:
        settings: devices and lease.
        socket: where to listen.
        configuration: where the settings are from, for those who ask.
        reread: returns the settings as they are now, for SIGHUP; ``None`` where there is no file.
        on_ready: called once commands are taken, with what is wrong with the devices, if anything;
            and again once nothing is.
        needs_devices: whether to end where a device is not ready.

    Raises:
        ConfigError: a device of the settings is not possible here.
        DaemonError: a device is not ready, and is needed.
        DaemonError: there is a daemon at *socket* already, or it cannot be listened at.
        KernelsError: nothing could be planned, for want of compiled kernels that this machine runs.
    """
    _share_arenas()
    processor.library()
    target(socket)  # whether the path can be that of a socket
    with claimed(socket):
        asyncio.run(_Daemon(settings, socket, configuration, reread, on_ready, needs_devices).run())


def _share_arenas() -> None:
    """Have a score of threads share two heaps, without what is large, which they would keep."""
    with contextlib.suppress(AttributeError):  # of a C library other than glibc
        for parameter, value in _MALLOC.items():
            ctypes.CDLL(None).mallopt(parameter, value)


class _Daemon:
    def __init__(
        self,
        settings: Settings,
        socket: Path,
        configuration: str,
        reread: Callable[[], Settings] | None,
        on_ready: Callable[[control_pb2.DaemonReport, list[str]], None],
        needs_devices: bool,
    ) -> None:
        self._needs_devices = needs_devices
        self._settings = self._initial = settings
        self._socket = socket
        self._configuration = configuration
        self._reread = reread
        self._on_ready = on_ready
        self._started = time.monotonic()
        self._stopping = asyncio.Event()
        self._telemetry: Telemetry | None = None
        self._stops: StopFolder | None = None
        self._fleet: FleetLink | None = None

    async def run(self) -> None:
        """Serve until told to stop; then bring everything to rest."""
        from orientd.daemon.standard import standard_methods

        loop = asyncio.get_running_loop()
        for number in (signal.SIGTERM, signal.SIGINT):
            loop.add_signal_handler(number, self._stop, number)
        access, status = self._settings.access, ServiceStatus()
        status.set(True)
        audit = AuditLog(
            audit_path(access), most_bytes=access.audit_bytes, most_files=access.audit_files
        )
        try:
            methods = standard_methods(SERVICE, status)
            authorization = Authorization(audit, methods, most_calls=access.streams)
            listener = Listener(access, self._settings.tcp, authorization.serve, audit)
            await self._listen(listener, authorization, audit, status)
        finally:
            audit.close()

    async def _listen(
        self,
        listener: Listener,
        authorization: Authorization,
        audit: AuditLog,
        status: ServiceStatus,
    ) -> None:
        loop = asyncio.get_running_loop()
        try:
            await listener.open(self._socket)
            self._stops = StopFolder(
                self._socket, listener.policy, record=partial(audit.record, event="stopped")
            )
            cell, service = await asyncio.to_thread(self._load)
            cell.planners.start()
            watchdog = Watchdog(cell.devices)
            try:
                self._measure(cell, authorization)
                watchdog.start()
                loop.add_signal_handler(signal.SIGHUP, self._reload, cell, listener, authorization)
                authorization.open(service.methods(), cell.leases.owner)
                self._join_fleet(cell, service, listener, authorization, audit)
                await self._serve(cell)
            finally:
                status.set(False)
                await asyncio.to_thread(cell.shutdown)
                service.end_calls()
                if self._fleet is not None:
                    await self._fleet.close()
                await cell.planners.close()
                await listener.close(GRACE)
                cell.close()
                watchdog.close()
                if self._telemetry is not None:
                    self._telemetry.close()
                _log.info("daemon: ended")
        finally:
            if self._stops is not None:
                self._stops.close()
            await listener.close()

    def _reload(self, cell: Cell, listener: Listener, authorization: Authorization) -> None:
        """Take up what can change of the settings, and say what cannot."""
        from orientd.daemon.reload import changes

        if self._reread is None:
            _log.warning("reload: there is no file of settings")
            return
        try:
            settings = self._reread()
            can, _ = changes(self._settings, settings)
            _, cannot = changes(self._initial, settings)
            begin = None if self._fleet is None else self._fleet.configured(settings)
            # The files that it names may have changed where the settings have not.
            listener.change(settings.access, settings.tcp)
        except OrientdError as error:
            _log.error("reload: nothing changed: %s", error)
            return
        if self._stops is not None:
            self._stops.admit(listener.policy)
        if self._fleet is not None and begin is not None:
            self._fleet.change(begin)
        logging.getLogger().setLevel(settings.daemon.log_level.upper())
        cell.bound(settings.access)
        authorization.most_calls = settings.access.streams
        is_wanting = settings.metrics is not None and self._telemetry is None
        is_measured_anew = is_wanting or settings.metrics != self._settings.metrics
        self._settings = settings
        if is_measured_anew:
            try:
                self._measure(cell, authorization)
            except ConfigError as error:
                _log.error("reload: %s", error)
        _log.info("reload: changed: %s", ", ".join(can) or "nothing but the files that are named")
        if cannot:
            _log.warning("reload: needs a restart: %s", ", ".join(cannot))

    def _measure(self, cell: Cell, authorization: Authorization) -> None:
        """Begin to count, where somebody may ask; what counted before ends.

        Raises:
            ConfigError: the port is in use, or the library is not installed.
        """
        if self._telemetry is not None:
            cell.listeners.remove(self._telemetry.hear)
            authorization.count_call = lambda *_: None
            self._telemetry.close()
            self._telemetry = None
        if self._settings.metrics is None:
            return
        from orientd.daemon.calls import Telemetry

        telemetry = Telemetry()
        telemetry.serve(self._settings.metrics)
        telemetry.follow(cell.devices)
        cell.listeners.append(telemetry.hear)
        authorization.count_call = telemetry.count_call
        self._telemetry = telemetry

    def _join_fleet(
        self,
        cell: Cell,
        service: ControlService,
        listener: Listener,
        authorization: Authorization,
        audit: AuditLog,
    ) -> None:
        """Be one of the daemons of a cell, where the settings name one.

        Raises:
            ConfigError: Zenoh cannot be configured so.
        """
        if self._settings.fleet is None:
            return
        from orientd.daemon.fleet import FleetLink

        self._fleet = FleetLink(
            self._settings, self._socket, service=SERVICE, listener=listener, audit=audit,
            serve=authorization.serve,
            state=service.present_state,
            journal=cell.journal,
        )  # fmt: skip
        self._fleet.start()

    def _load(self) -> tuple[Cell, ControlService]:
        """Import, and start, what takes its time."""
        from orientd.daemon.calls import ControlService
        from orientd.daemon.cell import Cell

        cell = Cell(self._settings, stops=self._stops)
        kernels = processor.level()
        _log.info("daemon: orientd %s with kernels for %s", orientd.__version__, kernels)
        cell.launch()
        return cell, ControlService(cell, lambda: self._describe(cell))

    async def _serve(self, cell: Cell) -> None:
        tasks = [asyncio.create_task(_expire_leases(cell))]
        problems = await asyncio.to_thread(
            cell.wait_ready, READY_TIMEOUT, is_cancelled=self._stopping.is_set
        )
        if not self._stopping.is_set():
            if problems and self._needs_devices:
                raise DaemonError("; ".join(problems))
            self._on_ready(self._describe(cell), problems)
            notify("READY=1")
            if problems:
                tasks.append(asyncio.create_task(self._start_again(cell)))
            # What was loaded stays for good; every full collection would take 20 ms over it.
            gc.collect()
            gc.freeze()
        await self._stopping.wait()
        notify("STOPPING=1")
        for task in tasks:
            task.cancel()

    async def _start_again(self, cell: Cell) -> None:
        """Start again what is not ready, ever more rarely, and say so once everything is."""
        pause = FIRST_PAUSE
        waiting = {name for name, device in cell.devices.items() if not device.wait_ready(0.0)}
        while waiting:
            await asyncio.sleep(pause)
            pause = min(2.0 * pause, LONGEST_PAUSE)
            for name in sorted(waiting):
                device = cell.devices[name]
                if device.failure:
                    await cell.in_worker(device.try_again)
                if device.wait_ready(0.0):
                    waiting.discard(name)
        self._on_ready(self._describe(cell), [])

    def _describe(self, cell: Cell) -> control_pb2.DaemonReport:
        """Return what there is to say about the daemon itself."""
        leases = [
            control_pb2.LeaseReport(
                holder=lease.holder,
                remaining=cell.leases.remaining(lease),
                identity=lease.owner,
                devices=lease.devices,
            )
            for lease in cell.leases.held()
        ]
        return control_pb2.DaemonReport(
            version=orientd.__version__,
            pid=os.getpid(),
            uptime=time.monotonic() - self._started,
            socket=str(self._socket),
            configuration=self._configuration,
            lease=leases[0] if leases else None,
            leases=leases,
        )

    def _stop(self, number: int) -> None:
        name = signal.Signals(number).name
        if self._stopping.is_set():
            _log.warning("daemon: %s: already stopping, the devices come to rest first", name)
            return
        _log.info("daemon: %s: stopping", name)
        self._stopping.set()


async def _expire_leases(cell: Cell) -> None:
    while True:
        await asyncio.sleep(_LEASE_CHECKS)
        if cell.leases.has_expired:
            await asyncio.to_thread(cell.leases.expire)
