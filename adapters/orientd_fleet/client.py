"""A client of a cell: presence, states, clocks, one stop for all, a robot for each daemon."""

from __future__ import annotations

import functools
import json
import os
import queue
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

from orientd.client.channel import certificate_files
from orientd.client.daemon_clock import Offset, Trip, clock_offset
from orientd.client.robot import Robot
from orientd.client.robot import connect as connect_daemon
from orientd.errors import DaemonError, OrientdError
from orientd_fleet.access import (
    common_name,
    open_session,
    session_configuration,
    tls_configuration,
)
from orientd_fleet.keys import LOCAL, daemon_of, key_of, name_of
from orientd_fleet.settings import TLS

if TYPE_CHECKING:
    import zenoh

    from orientd_fleet.recording import FleetRecording

SETTLING = 3.0
"""How long a client waits for the first daemon of the cell unless told otherwise, s."""

QUIET = 0.3
"""How long no other daemon may appear until the cell counts as complete, s."""

STOP_TIMEOUT = 2.0
"""How long a daemon may take to acknowledge a stop, s."""

_ASK_TIMEOUT = 1.0

KEPT = 256
"""Round trips that are remembered."""

BURST = 40
"""Round trips of one measurement."""

SPACING = 0.005
"""How long an answer is waited for before the next question is sent, s: a slow link is not idle."""

PATIENCE = 1.0
"""How long the last answers are waited for, s."""

Ask = Callable[[Callable[[int], None]], object]
"""Asks for the other clock's reading, ns, and hands it to a function once it is here."""


def daemon_address(
    name: str,
    certificate: str | Path | None,
    key: str | Path | None,
    ca: str | Path | None,
) -> str:
    """Return where the daemon *name* takes calls, in the cell that the environment names.

    The certificates are as for :func:`connect_fleet`.

    Raises:
        DaemonError: there is no such daemon, or no such cell.
    """
    with connect_fleet(wait_for=[name], certificate=certificate, key=key, ca=ca) as fleet:
        return fleet.address(name)


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
        connect: Zenoh endpoints of one or several daemons or routers, which know the others; by
            default ``$ORIENTD_FLEET``, separated by spaces.
        cell: its name; by default ``$ORIENTD_CELL``.
        certificate: of this client, a file; by default ``$ORIENTD_CERT``.
        key: of that certificate, a file; by default ``$ORIENTD_KEY``.
        ca: signer of all certificates of the cell, a file; by default ``$ORIENTD_CA``.
        wait_for: daemons to wait for; by default for the first, and until no others appear.
        timeout: how long to try to connect, and then to wait for daemons, s.

    Raises:
        DaemonError: no daemon is there, or not all that were waited for.
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
    configuration = session_configuration([], endpoints, timeout=timeout)
    files: list[Path] = []
    if any(endpoint.startswith(TLS) for endpoint in endpoints):
        files = certificate_files(endpoints[0], certificate, key, ca)
        configuration["transport"]["link"]["tls"] = tls_configuration(*files)
    caller = common_name(*files) if files else LOCAL
    fleet = Fleet(open_session(configuration), cell=cell, caller=caller, files=files)
    try:
        fleet.find(wait_for, timeout=timeout)
    except OrientdError as error:
        fleet.close()
        raise DaemonError(f"{error} at {' '.join(endpoints)}") from error
    return fleet


@dataclass(frozen=True, slots=True)
class Stopped:
    """A daemon's answer to a stop.

    Attributes:
        daemon: its name.
        devices: for each, ``name``, ``state`` and ``motion`` when the stop reached it.
        seconds: from the call to the answer.
        taken_after: from the call until the servos had taken the stop, by the daemon's clock and
            its measured offset, s; ``None`` if that is not known.
        problem: why the daemon may not have stopped; empty if it has.
    """

    daemon: str
    devices: Sequence[dict[str, Any]]
    seconds: float
    taken_after: float | None = None
    problem: str = ""


class Fleet:
    """A client's connection to a cell; a context manager.  Safe to use from any thread.

    Attributes:
        cell: its name.
        caller: the name of this client.
    """

    def __init__(
        self, session: zenoh.Session, *, cell: str, caller: str, files: Sequence[Path] = ()
    ) -> None:
        """Look for the daemons of *cell*; see :func:`connect_fleet`.

        Args:
            session: of Zenoh.
            cell: its name.
            caller: the name of this client.
            files: certificate, key and CA of this client, in a cell with TLS.
        """
        import zenoh

        self._zenoh, self._session = zenoh, session
        self.cell, self.caller, self._files = cell, caller, files
        self._news = threading.Condition()
        self._addresses: dict[str, str] = {}
        self._clocks: dict[str, ClockOffset] = {}
        self._robots: list[Robot] = []
        self._declared: list[object] = [
            session.liveliness().declare_subscriber(
                key_of(cell, "*", "alive", "**"), self._hear_alive, history=True
            )
        ]

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Leave the cell, and close its robots."""
        for robot in self._robots:
            robot.close()
        self._session.close()  # type: ignore[no-untyped-call] # Zenoh's stub

    # Presence

    @property
    def daemons(self) -> list[str]:
        """The daemons that are there now, in the order of their names."""
        with self._news:
            return sorted(self._addresses)

    def find(self, names: Sequence[str] = (), *, timeout: float = SETTLING) -> list[str]:
        """Wait for *names*, or until no other daemon appears; return all that are there.

        Raises:
            DaemonError: they do not appear in time.
        """
        end = time.monotonic() + timeout
        known = self._addresses
        with self._news:
            self._news.wait_for(lambda: known and known.keys() >= set(names), timeout)
            count = len(known) if names else 0
            while count < len(known) and time.monotonic() < end:
                count = len(known)
                self._news.wait_for(lambda: len(known) > count, QUIET)  # noqa: B023
            missing = ", ".join(sorted(set(names) - known.keys()))
            if missing:
                raise DaemonError(f"cell {self.cell} has no {missing}")
            if not known:
                raise DaemonError(f"there is no daemon of cell {self.cell}")
        return self.daemons

    def _hear_alive(self, sample: zenoh.Sample) -> None:
        place = str(sample.key_expr)
        daemon, address = daemon_of(place), name_of(place)
        with self._news:
            if sample.kind == self._zenoh.SampleKind.PUT:
                self._addresses[daemon] = address
            elif self._addresses.get(daemon) == address:
                del self._addresses[daemon]
            self._news.notify_all()

    def address(self, daemon: str) -> str:
        """Return where a daemon takes calls: ``HOST:PORT``, or ``unix:`` and its socket.

        Raises:
            DaemonError: the daemon is not there.
        """
        with self._news:
            if daemon not in self._addresses:
                raise DaemonError(f"cell {self.cell} has no {daemon}")
            return self._addresses[daemon]

    def robot(self, daemon: str, *, holder: str = "", timeout: float = 30.0) -> Robot:
        """Connect to a daemon as :func:`orientd.connect` does, at the address of its presence.

        Raises:
            DaemonError: it is not there, or does not answer.
            AccessError: it does not let this caller do anything.
        """
        certificate, key, ca = self._files or (None, None, None)
        robot = connect_daemon(
            address=self.address(daemon), certificate=certificate, key=key, ca=ca,
            holder=holder, timeout=timeout,
        )  # fmt: skip
        self._robots.append(robot)
        return robot

    # Clocks and states

    def subscribe(self, what: str, hear: Callable[[zenoh.Sample], object]) -> None:
        """Call *hear* with everything that any daemon publishes as *what* from now on."""
        self._declared.append(self._session.declare_subscriber(key_of(self.cell, "*", what), hear))

    def clock(self, daemon: str) -> ClockOffset:
        """Return what is known of a daemon's clock."""

        def ask(hear: Callable[[int], None]) -> None:
            def take(reply: zenoh.Reply) -> None:
                if reply.ok is not None:
                    hear(int.from_bytes(reply.ok.payload.to_bytes(), "little"))

            self._session.get(
                key_of(self.cell, daemon, "clock"),
                # In Zenoh's own thread: a thread of ours would add its delay.
                self._zenoh.handlers.Callback(take, indirect=False),
                timeout=_ASK_TIMEOUT,
                priority=self._zenoh.Priority.REAL_TIME,
                express=True,
            )

        with self._news:
            return self._clocks.setdefault(daemon, ClockOffset(ask))

    def offset(self, daemon: str) -> Offset:
        """Measure how far a daemon's clock is ahead of ours.

        Raises:
            DaemonError: it does not answer.
        """
        offset = self.clock(daemon).measure()
        if offset is None:
            raise DaemonError(f"{daemon} does not tell its time")
        return offset

    # Stop

    def stop(self, *, is_quickest: bool = False, timeout: float = STOP_TIMEOUT) -> list[Stopped]:
        """Stop every device of the cell with one message; return each daemon's answer.

        Args:
            is_quickest: whether to leave the path if that is quicker.
            timeout: how long to wait for acknowledgements, s.
        """
        began = time.monotonic_ns()
        answers: queue.SimpleQueue[Stopped | None] = queue.SimpleQueue()

        def hear(reply: zenoh.Reply) -> None:
            if reply.ok is not None:
                name, seconds = daemon_of(str(reply.ok.key_expr)), time.monotonic_ns() - began
                told = json.loads(reply.ok.payload.to_bytes())
                offset = self.clock(name).at(began)
                taken = None if offset is None else (told["time_ns"] - offset.ns - began) * 1e-9
                devices, problem = told.get("devices") or (), told.get("error", "")
                answers.put(Stopped(name, devices, seconds * 1e-9, taken, problem))

        all_stops = key_of(self.cell, "*", "stop", self.caller)
        self._session.get(
            f"{all_stops}?kind=halt" if is_quickest else all_stops,
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

    def record(self, path: str | Path, daemons: Sequence[str] = ()) -> FleetRecording:
        """Return a recording of every cycle, event and plan of the cell in one MCAP file.

        Args:
            path: of the file, which is overwritten.
            daemons: their names; by default every daemon that is there meanwhile.
        """
        from orientd_fleet.recording import FleetRecording

        return FleetRecording(self, Path(path), daemons)


class ClockOffset:
    """The offset of one other clock, from round trips.  Safe to call from any thread."""

    def __init__(self, ask: Ask, *, now_ns: Callable[[], int] = time.monotonic_ns) -> None:
        """Know of no trip yet.

        Args:
            ask: asks for the other clock.
            now_ns: our clock.
        """
        self._ask, self._now_ns = ask, now_ns
        self._lock = threading.Lock()
        self._trips: deque[Trip] = deque(maxlen=KEPT)

    def measure(self, trips: int = BURST) -> Offset | None:
        """Make some round trips; return the offset now, ``None`` if no answer ever came."""
        heard = [threading.Event() for _ in range(trips)]
        for is_heard in heard:
            self._ask(functools.partial(self._hear, self._now_ns(), is_heard))
            is_heard.wait(SPACING)
        end = time.monotonic() + PATIENCE
        for is_heard in heard:
            is_heard.wait(max(0.0, end - time.monotonic()))
        return self.at(self._now_ns())

    def _hear(self, asked_ns: int, is_heard: threading.Event, there_ns: int) -> None:
        answered_ns = self._now_ns()
        with self._lock:
            self._trips.append(Trip(asked_ns, there_ns, answered_ns))
        is_heard.set()

    @property
    def round_trip_ns(self) -> int:
        """How long a round trip takes, all but the slowest of the last; 0 before the first."""
        with self._lock:
            last = sorted(trip.answered_ns - trip.asked_ns for trip in list(self._trips)[-BURST:])
        return last[len(last) * 9 // 10] if last else 0

    def at(self, time_ns: int) -> Offset | None:
        """Return the offset at a time of our clock; ``None`` before the first trip."""
        with self._lock:
            return clock_offset(self._trips, time_ns) if self._trips else None
