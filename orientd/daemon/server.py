"""The daemon: a gRPC server on a Unix domain socket, from its start to its orderly end."""

from __future__ import annotations

import asyncio
import contextlib
import ctypes
import gc
import logging
import signal
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from grpclib.health.check import ServiceStatus

import orientd
from orientd import processor
from orientd.client.channel import target
from orientd.config import Settings
from orientd.daemon.access.audit import AuditLog, audit_path
from orientd.daemon.access.authorization import Authorization
from orientd.daemon.access.claim import claimed
from orientd.daemon.access.identity import RolePolicy
from orientd.daemon.access.listener import Listener, Tables
from orientd.daemon.calls.service import Service
from orientd.daemon.devices import Devices
from orientd.daemon.standard import standard_methods
from orientd.daemon.stops import StopFolder
from orientd.daemon.systemd import Watchdog, notify
from orientd.daemon.workers import Threads
from orientd.errors import DaemonError, OrientdError
from orientd.protocol import control_pb2

if TYPE_CHECKING:
    from orientd.daemon.calls.telemetry import Telemetry
    from orientd.daemon.device import Device, DeviceEvent

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
    """Run the daemon until SIGTERM or SIGINT.

    If a device is not ready when the daemon is, the daemon restarts it at intervals.

    Args:
        settings: devices and lease.
        socket: where to listen.
        configuration: source of the settings, for clients that ask.
        reread: returns the settings as they are now, for SIGHUP; ``None`` if there is no file.
        on_ready: called once the daemon accepts commands, with the problems of the devices if
            there are any; called again once there are none.
        needs_devices: whether to end if a device is not ready.

    Raises:
        ConfigError: a device of the settings is not possible here.
        DaemonError: a device is not ready, and is needed.
        DaemonError: there is a daemon at *socket* already, or it cannot be listened at.
        KernelsError: nothing could be planned, for want of compiled kernels that this machine runs.
    """
    _share_arenas()
    processor.library()
    target(socket)  # whether the path can be that of a socket
    with claimed(socket), contextlib.ExitStack() as ending:
        daemon = _Daemon(
            settings, socket, configuration, reread, on_ready, needs_devices, ending=ending
        )
        asyncio.run(daemon.run())


def _share_arenas() -> None:
    """Make the threads share two heaps, so that each does not keep large blocks of its own."""
    with contextlib.suppress(AttributeError):  # of a C library other than glibc
        for parameter, value in _MALLOC.items():
            ctypes.CDLL(None).mallopt(parameter, value)


class _NewSettings(NamedTuple):
    """Everything that a reload applies.

    Attributes:
        settings: as they are now.
        can: the keys that have changed.
        cannot: the keys that need a restart.
        tables: roles and certificates.
        telemetry: serves the metrics, if the settings have a port for them.
    """

    settings: Settings
    can: list[str]
    cannot: list[str]
    tables: Tables
    telemetry: Telemetry | None


class _Daemon:
    """Everything that a daemon is made of, and what happens to it."""

    def __init__(
        self,
        settings: Settings,
        socket: Path,
        configuration: str,
        reread: Callable[[], Settings] | None,
        on_ready: Callable[[control_pb2.DaemonReport, list[str]], None],
        needs_devices: bool,
        *,
        ending: contextlib.ExitStack,
    ) -> None:
        """Make all of it and start nothing; see :func:`run`.

        Args:
            settings: as they are at present.
            socket: where to listen.
            configuration: where the settings are from.
            reread: returns the settings as they are now.
            on_ready: called once the daemon takes commands.
            needs_devices: whether to end if a device is not ready.
            ending: closes what the daemon holds, when it has ended or cannot be made.
        """
        self._settings = self._initial = settings
        self._reread, self._on_ready, self._needs_devices = reread, on_ready, needs_devices
        self._socket = socket
        self._stopping = asyncio.Event()
        self._life, self._reading = Threads(1, "life"), Threads(1, "reload")
        self._reloading: asyncio.Task[None] | None = None
        self._status = ServiceStatus()
        access = settings.access
        self._audit = AuditLog(
            audit_path(access), most_bytes=access.audit_bytes, most_files=access.audit_files
        )
        ending.callback(self._audit.close)
        self._stops = StopFolder(
            socket, RolePolicy(access), record=partial(self._audit.record, event="stopped")
        )
        ending.callback(self._stops.close)
        self._telemetry: Telemetry | None = None
        self._devices = Devices(settings, stops=self._stops, on_event=self._on_event)
        self._service = Service(
            self._devices,
            keyframes=access.keyframes,
            socket=socket,
            configuration=configuration,
            began=time.monotonic(),
        )
        methods = {**standard_methods(SERVICE, self._status), **self._service.methods()}
        self._authorization = Authorization(
            methods,
            self._audit,
            count_call=self._count_call,
            most_calls=access.streams,
        )
        self._listener = Listener(access, settings.tcp, self._authorization.route, self._audit)
        self._watchdog = Watchdog(self._devices.by_name)

    async def run(self) -> None:
        """Serve until told to stop; then bring everything to rest."""
        loop = asyncio.get_running_loop()
        for number in (signal.SIGTERM, signal.SIGINT):
            loop.add_signal_handler(number, self._stop, number)
        _log.info("daemon: orientd %s with kernels for %s", orientd.__version__, processor.level())
        await self._listener.open(self._socket)
        try:
            self._telemetry = self._measured(self._settings)
            self._devices.planners.start()
            await self._life.run(self._devices.launch)
            self._watchdog.start()
            loop.add_signal_handler(signal.SIGHUP, self._reload)
            self._status.set(True)
            await self._serve()
        finally:
            await self._end()

    async def _end(self) -> None:
        """Bring the devices to rest, then let calls end and close everything."""
        self._status.set(False)
        await self._life.run(self._devices.shutdown)
        self._service.end_calls()
        await self._devices.planners.close()
        await self._listener.close(GRACE)
        self._devices.close()
        self._watchdog.close()
        if self._telemetry is not None:
            self._telemetry.close()
        _log.info("daemon: ended")
        # The process still takes a moment to end, and a second signal must not kill it meanwhile.
        for number in (signal.SIGTERM, signal.SIGINT):
            asyncio.get_running_loop().remove_signal_handler(number)
            signal.signal(number, signal.SIG_IGN)

    def _reload(self) -> None:
        self._reloading = asyncio.create_task(self._apply_settings(self._reloading))

    async def _apply_settings(self, before: asyncio.Task[None] | None = None) -> None:
        """Apply the settings that can change while the daemon runs, and name those that cannot.

        Everything is read first, in a thread, because files and names may take their time.  Then
        all of it is applied at once, or nothing.
        """
        if before is not None:
            await asyncio.wait((before,))
        if self._reread is None:
            _log.warning("reload: there is no file of settings")
            return
        try:
            new = await self._reading.run(self._read_settings, self._reread)
        except OrientdError as error:
            _log.error("reload: nothing changed: %s", error)
            return
        settings, telemetry = new.settings, self._telemetry
        self._listener.change(new.tables)
        logging.getLogger().setLevel(settings.daemon.log_level.upper())
        self._service.keyframes = settings.access.keyframes
        self._authorization.most_calls = settings.access.streams
        self._settings, self._telemetry = settings, new.telemetry
        _log.info(
            "reload: changed: %s", ", ".join(new.can) or "nothing but the files that are named"
        )
        if new.cannot:
            _log.warning("reload: needs a restart: %s", ", ".join(new.cannot))
        await self._reading.run(self._stops.admit, self._listener.policy)
        if telemetry is not None and telemetry is not new.telemetry:
            await self._reading.run(telemetry.close)

    def _read_settings(self, reread: Callable[[], Settings]) -> _NewSettings:
        """Read the settings and the files that they name, and open the port of the metrics.

        Raises:
            OrientdError: something is missing or wrong.
        """
        settings = reread()
        can, _ = changes(self._settings, settings)
        _, cannot = changes(self._initial, settings)
        return _NewSettings(
            settings,
            can,
            cannot,
            # The files that it names may have changed where the settings have not.
            self._listener.read(settings.access, settings.tcp),
            # Last: nothing after it fails, which would leave its port open.
            self._telemetry
            if self._settings.metrics == settings.metrics
            else self._measured(settings),
        )

    def _measured(self, settings: Settings) -> Telemetry | None:
        """Return what counts for Prometheus, if the settings have a port for it.

        Raises:
            ConfigError: the port is in use, or the library is not installed.
        """
        if settings.metrics is None:
            return None
        from orientd.daemon.calls.telemetry import Telemetry

        return Telemetry(settings.metrics, self._devices.by_name)

    def _on_event(self, event: DeviceEvent, device: Device) -> None:
        if self._telemetry is not None:
            self._telemetry.on_event(event, device)

    def _count_call(self, method: str, code: str, seconds: float) -> None:
        if self._telemetry is not None:
            self._telemetry.count_call(method, code, seconds)

    async def _serve(self) -> None:
        """Wait for the devices, say that the daemon is ready, and serve until it is to stop."""
        devices = self._devices
        tasks = [asyncio.create_task(_expire_leases(devices))]
        is_ready = partial(devices.wait_ready, READY_TIMEOUT, is_cancelled=self._stopping.is_set)
        problems = await self._life.run(is_ready)
        missing = await self._missing_planners()
        if missing:
            problems.append(missing)
        if not self._stopping.is_set():
            if problems and self._needs_devices:
                raise DaemonError("; ".join(problems))
            self._on_ready(self._service.daemon_report(), problems)
            notify("READY=1")
            if problems:
                tasks.append(asyncio.create_task(self._start_again()))
            # Loaded modules stay until the end; a full collection would spend 20 ms on them.
            gc.collect()
            gc.freeze()
        await self._stopping.wait()
        notify("STOPPING=1")
        for task in tasks:
            task.cancel()

    async def _missing_planners(self) -> str:
        """Wait until there is a planner, and return why there is none; empty if there is one.

        However long that takes, or the first motion would not begin in time; but not for longer
        than the daemon is to run.
        """
        starting = asyncio.create_task(self._devices.planners.started())
        stopping = asyncio.create_task(self._stopping.wait())
        await asyncio.wait((starting, stopping), return_when=asyncio.FIRST_COMPLETED)
        missing = starting.result() if starting.done() else ""
        for task in (starting, stopping):
            task.cancel()
        return missing

    async def _start_again(self) -> None:
        """Start what is not ready again, and say so once all of it is."""
        devices = self._devices
        await asyncio.gather(*map(_start_device_again, devices.by_name.values()))
        await devices.planners.can_plan()
        self._on_ready(self._service.daemon_report(), [])

    def _stop(self, number: int) -> None:
        name = signal.Signals(number).name
        if self._stopping.is_set():
            _log.warning("daemon: %s: already stopping, the devices come to rest first", name)
            return
        _log.info("daemon: %s: stopping", name)
        self._stopping.set()


async def _expire_leases(devices: Devices) -> None:
    while True:
        await asyncio.sleep(_LEASE_CHECKS)
        if devices.leases.has_expired:
            devices.leases.expire()


async def _start_device_again(device: Device) -> None:
    """Start a device until it is ready, ever more rarely."""
    pause = FIRST_PAUSE
    while not device.wait_ready(0.0):
        await asyncio.sleep(pause)
        pause = min(2.0 * pause, LONGEST_PAUSE)
        if device.failure:
            with contextlib.suppress(OrientdError):
                await device.workers.commands.run(device.reset)


CHANGEABLE = (
    "daemon.log_level",
    "access.users",
    "access.groups",
    "access.certificates",
    "access.keyframes",
    "access.streams",
    "tcp.certificate",
    "tcp.key",
    "tcp.ca",
    "tcp.crl",
    "tcp.revoked",
    "metrics",
)
"""Keys, with everything below them; the daemon reads the files that they name again too."""


def changes(before: Settings, after: Settings) -> tuple[list[str], list[str]]:
    """Return the keys that differ: those that can change while the daemon runs, and the others."""
    differing = sorted(set(_differing(before.model_dump(), after.model_dump(), "")))
    can = [key for key in differing if any(f"{key}.".startswith(f"{c}.") for c in CHANGEABLE)]
    return can, [key for key in differing if key not in can]


def _differing(before: Any, after: Any, key: str) -> Iterator[str]:  # noqa: ANN401 - any value
    if before == after:
        return
    if isinstance(before, dict) and isinstance(after, dict):
        for name in before.keys() | after.keys():
            inner = f"{key}.{name}" if key else str(name)
            yield from _differing(before.get(name), after.get(name), inner)
    else:
        yield key
