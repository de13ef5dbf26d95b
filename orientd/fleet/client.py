"""A client of a cell: who is there, how they are, one stop for all, a robot for each of them."""

from __future__ import annotations

import json
import os
import queue
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

from orientd.config import TLS
from orientd.errors import DaemonError, OrientdError
from orientd.fleet import keys
from orientd.fleet.access import basic_configuration, common_name, tls_configuration
from orientd.fleet.channel import FleetChannel
from orientd.fleet.clocks import ClockOffset
from orientd.fleet.session import open_session
from orientd.rpc import Robot, Way, certificate_files, connect_by, default_socket
from orientd.rpc import control_pb2 as pb

if TYPE_CHECKING:
    import grpc
    import zenoh

    from orientd.fleet.recording import FleetRecording

SETTLING = 3.0
"""How long a client waits for the first daemon of the cell unless told otherwise, s."""

QUIET = 0.3
"""How long nobody else may appear until everybody counts as found, s."""

STOP_TIMEOUT = 2.0
"""How long a daemon may take to acknowledge a stop, s."""

_ASK_TIMEOUT = 1.0

ADDRESS = "fleet:"
"""What the address of a daemon of a cell begins with: ``fleet:DAEMON``."""


@dataclass(frozen=True, kw_only=True)
class FleetMember(Way):
    """The way to a daemon of a cell.

    Attributes:
        fleet: knows the cell.
        name: of the daemon.
    """

    fleet: Fleet | None = None
    name: str = ""

    @classmethod
    def at(
        cls,
        address: str,
        certificate: str | Path | None,
        key: str | Path | None,
        ca: str | Path | None,
    ) -> FleetMember:
        """Return the way to ``fleet:NAME``, of the cell that the environment names.

        The certificates are as for :func:`connect_fleet`.
        """
        name = address.removeprefix(ADDRESS)
        files = (None if path is None else Path(path) for path in (certificate, key, ca))
        return cls(_kept(name), address, *files, name=name)

    def why_not(self) -> OrientdError | None:
        """Return nothing: whether a daemon is there is what the call has found out."""
        return None

    def open(self) -> grpc.Channel:
        """Return a channel to the daemon; without a fleet, one that ends its own.

        Raises:
            DaemonError: there is no such daemon, or no such cell.
        """
        if self.fleet is not None:
            return self.fleet.channel(self.name)
        fleet = connect_fleet(
            wait_for=[self.name], certificate=self.certificate, key=self.key, ca=self.ca
        )
        return fleet.channel(self.name, on_close=fleet.close)


def _kept(name: str) -> Path:
    """Return where what belongs to a daemon of a cell is kept."""
    return default_socket().with_name(f"{name}.fleet")


def connect_fleet(
    connect: str | Sequence[str] | None = None,
    *,
    cell: str | None = None,
    certificate: str | Path | None = None,
    key: str | Path | None = None,
    ca: str | Path | None = None,
    wait_for: Sequence[str] = (),
    timeout: float = SETTLING,
) -> Fleet:
    """Connect to a cell of daemons.

    Args:
        connect: Zenoh's endpoints of one or several daemons or routers, which know the others; by
            default ``$ORIENTD_FLEET``, separated by blanks.
        cell: its name; by default ``$ORIENTD_CELL``.
        certificate: who this client is, a file; by default ``$ORIENTD_CERT``.
        key: of that certificate, a file; by default ``$ORIENTD_KEY``.
        ca: who has signed everybody's certificate, a file; by default ``$ORIENTD_CA``.
        wait_for: daemons to wait for; by default for the first, and until no others appear.
        timeout: how long to try to connect, and then to wait for daemons, s.

    Raises:
        DaemonError: nobody is there, or one that was waited for is not.
        ConfigError: the extra ``fleet`` is not installed.
    """
    given = os.environ.get("ORIENTD_FLEET", "") if connect is None else connect
    endpoints = given.split() if isinstance(given, str) else list(given)
    cell = cell or os.environ.get("ORIENTD_CELL")
    if not endpoints or not cell:
        raise DaemonError(
            "a fleet needs an endpoint and the name of the cell: --connect and --cell, or the "
            "environment's ORIENTD_FLEET and ORIENTD_CELL"
        )
    configuration = basic_configuration([], endpoints, timeout=timeout)
    caller = keys.LOCAL
    if any(endpoint.startswith(TLS) for endpoint in endpoints):
        files = certificate_files(endpoints[0], certificate, key, ca)
        configuration |= tls_configuration(*files)
        caller = common_name(*files)
    fleet = Fleet(open_session(configuration), cell=cell, caller=caller)
    try:
        fleet.find(wait_for, timeout=timeout)
    except OrientdError as error:
        fleet.close()
        raise DaemonError(f"{error} at {' '.join(endpoints)}") from error
    return fleet


@dataclass(frozen=True, slots=True)
class Stopped:
    """What a daemon says of a stop.

    Attributes:
        daemon: its name.
        devices: of each ``name``, ``state`` and ``motion`` as the stop met them.
        seconds: from the call until its answer was here.
        taken_after: from the call until its servos had taken the stop, by its clock and what is
            known of that, s; ``None`` where nothing is.
        problem: why it is not known to have stopped; empty if it is.
    """

    daemon: str
    devices: Sequence[dict[str, Any]]
    seconds: float
    taken_after: float | None = None
    problem: str = ""


@dataclass(frozen=True, slots=True)
class Heard:
    """The newest state of a daemon.

    Attributes:
        state: as the daemon tells it.
        taken_ns: when, on the daemon's monotonic clock.
        heard_ns: when it was here, on ours.
    """

    state: pb.GetStateResponse
    taken_ns: int
    heard_ns: int


class Fleet:
    """A client's connection to a cell; a context manager.  Safe to use from any thread.

    Attributes:
        cell: its name.
        caller: who asks.
        states: how many were heard of all daemons together.
    """

    def __init__(self, session: zenoh.Session, *, cell: str, caller: str) -> None:
        """Look for the daemons of *cell*, as *caller*."""
        import zenoh

        self._zenoh, self._session = zenoh, session
        self.cell, self.caller = cell, caller
        self._news = threading.Condition()
        self._daemons: set[str] = set()
        self._heard: dict[str, Heard] = {}
        self.states = 0
        self._clocks: dict[str, ClockOffset] = {}
        live, presence = session.liveliness(), keys.presence(cell, caller, str(session.zid()))
        self._declared = [
            live.declare_token(presence),
            live.declare_subscriber(
                keys.of_daemon(cell, "*", "alive"), self._hear_alive, history=True
            ),
        ]

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Leave the cell, which ends what was asked of it."""
        self._session.close()  # type: ignore[no-untyped-call] # Zenoh's stub

    # Who is there

    @property
    def daemons(self) -> list[str]:
        """The daemons that are there now, in the order of their names."""
        with self._news:
            return sorted(self._daemons)

    def find(self, names: Sequence[str] = (), *, timeout: float = SETTLING) -> list[str]:
        """Wait for *names*, or until nobody else appears; return who is there.

        Raises:
            DaemonError: they do not appear in time.
        """
        end = time.monotonic() + timeout
        with self._news:
            self._news.wait_for(lambda: self._daemons and self._daemons >= set(names), timeout)
            if not names:
                known = 0
                while len(self._daemons) > known and time.monotonic() < end:
                    known = len(self._daemons)
                    self._news.wait_for(lambda: len(self._daemons) > known, QUIET)  # noqa: B023
            missing = set(names) - self._daemons
            if missing:
                absent = ", ".join(sorted(missing))
                raise DaemonError(f"cell {self.cell} has no {absent}")
            if not self._daemons:
                raise DaemonError(f"there is no daemon of cell {self.cell}")
        return self.daemons

    def _hear_alive(self, sample: zenoh.Sample) -> None:
        name = keys.daemon_of(str(sample.key_expr))
        with self._news:
            if sample.kind == self._zenoh.SampleKind.PUT:
                self._daemons.add(name)
            else:
                self._daemons.discard(name)
            self._news.notify_all()

    # How they are

    def watch(self) -> None:
        """Hear the states of all daemons from now on; see :meth:`heard`."""
        key = keys.of_daemon(self.cell, "*", "state")
        self._declared.append(self._session.declare_subscriber(key, self._hear_state))

    def heard(self) -> dict[str, Heard]:
        """Return the newest state of each daemon that has told one."""
        with self._news:
            return dict(self._heard)

    def _hear_state(self, sample: zenoh.Sample) -> None:
        told = json.loads(sample.attachment.to_bytes() if sample.attachment else b"{}")
        state = pb.GetStateResponse.FromString(sample.payload.to_bytes())
        heard = Heard(state, told.get("time_ns", 0), time.monotonic_ns())
        with self._news:
            self.states += 1
            self._heard[keys.daemon_of(str(sample.key_expr))] = heard
            self._news.notify_all()

    def clock(self, daemon: str) -> ClockOffset:
        """Return what is known of a daemon's clock."""
        key = keys.as_caller(self.cell, daemon, self.caller, "clock")

        def ask(hear: Callable[[int], None]) -> None:
            def take(reply: zenoh.Reply) -> None:
                if reply.ok is not None:
                    hear(int.from_bytes(reply.ok.payload.to_bytes(), "little"))

            # In Zenoh's own thread: a thread of ours would be one more to wait for.
            answer = self._zenoh.handlers.Callback(take, indirect=False)
            self._session.get(
                key, answer, timeout=_ASK_TIMEOUT, priority=self._zenoh.Priority.REAL_TIME,
                express=True,
            )  # fmt: skip

        with self._news:
            return self._clocks.setdefault(daemon, ClockOffset(ask))

    # What they do

    def stop(self, *, is_quickest: bool = False, timeout: float = STOP_TIMEOUT) -> list[Stopped]:
        """Stop every device of the cell by one message; return what each daemon says to it.

        Args:
            is_quickest: whether to leave the path where that is quicker.
            timeout: how long to wait for acknowledgements, s.
        """
        began = time.monotonic_ns()
        answers: queue.SimpleQueue[Stopped | None] = queue.SimpleQueue()

        def hear(reply: zenoh.Reply) -> None:
            if reply.ok is not None:
                name, seconds = keys.daemon_of(str(reply.ok.key_expr)), time.monotonic_ns() - began
                told = json.loads(reply.ok.payload.to_bytes())
                offset = self.clock(name).at(began)
                taken = None if offset is None else (told["time_ns"] - offset.ns - began) * 1e-9
                devices, problem = told.get("devices") or (), told.get("error", "")
                answers.put(Stopped(name, devices, seconds * 1e-9, taken, problem))

        key = keys.as_caller(self.cell, "*", self.caller, "stop")
        self._session.get(
            f"{key}?kind=halt" if is_quickest else key,
            self._zenoh.handlers.Callback(hear, lambda: answers.put(None)),
            target=self._zenoh.QueryTarget.ALL,
            consolidation=self._zenoh.ConsolidationMode.NONE,
            priority=self._zenoh.Priority.REAL_TIME,
            express=True,
            timeout=timeout,
        )
        expected = set(self.daemons)
        found: dict[str, Stopped] = {}
        while not expected or expected - found.keys():
            answer = answers.get()
            if answer is None:
                break
            found[answer.daemon] = answer
        for name in expected - found.keys():
            found[name] = Stopped(name, (), timeout, problem="has not acknowledged the stop")
        return [found[name] for name in sorted(found)]

    def channel(
        self, daemon: str, *, on_close: Callable[[], object] = lambda: None
    ) -> FleetChannel:
        """Return a channel to a daemon, for a stub of the protocol.

        Args:
            daemon: its name.
            on_close: called when the channel is closed.
        """
        return FleetChannel(
            self._session, cell=self.cell, daemon=daemon, caller=self.caller, on_close=on_close
        )

    def robot(self, daemon: str, *, holder: str = "", timeout: float = 30.0) -> Robot:
        """Return a daemon as :func:`orientd.connect` does: every call works.

        Raises:
            DaemonError: it does not answer.
            AccessError: it does not let this caller do anything.
        """
        way = FleetMember(_kept(daemon), f"{self.cell}/{daemon}", fleet=self, name=daemon)
        return connect_by(way, holder=holder, timeout=timeout)

    def record(
        self, path: str | Path, daemons: Sequence[str] = (), *, has_scalars: bool = False
    ) -> FleetRecording:
        """Return what records every cycle, event and plan of the cell to one MCAP file.

        Args:
            path: of the file, which is overwritten.
            daemons: their names; whoever is there meanwhile, where none is named.
            has_scalars: whether every cycle is written as plain numbers too, for tools that plot.
        """
        from orientd.fleet.recording import FleetRecording

        return FleetRecording(self, Path(path), daemons, has_scalars=has_scalars)
