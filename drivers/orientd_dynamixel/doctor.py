"""Inspect a deployment's bus: port, adapter, every servo, and the highest rate of the bus.

It changes nothing; every finding comes with its remedy.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Iterable, Sequence
from pathlib import Path
from statistics import median_high
from typing import NamedTuple

from orientd.driver import Finding, Verdict
from orientd.errors import DeviceError, LinkError
from orientd_dynamixel.bus import ATTEMPTS, READ_WAIT_S, OpenBus, Row, ServoBus, open_bus
from orientd_dynamixel.group import cycle_bytes
from orientd_dynamixel.options import GimbalOptions
from orientd_dynamixel.servo import Servo
from orientd_dynamixel.tables import (
    BAUD_RATES,
    DELAY_US,
    MODELS,
    ControlTable,
    ServoModel,
    explain_error,
)

SCAN_WAIT_MS = 4.0

_IDS = 21
"""Ids to ask in addition to the configured ones: 0 to 20."""
_GOOD_TIMER_MS = 1.0
"""Assumed latency timer of an adapter that does not report it: the recommended value."""
_GOOD_BAUD = 1_000_000
_TURNAROUND_MS = 0.05
_HOST_MS = 0.3
"""Time that the host needs in each cycle, with a margin."""
_SAFE_SHARE = 0.57
"""Largest share of a cycle for the bus; the worst case takes about twice the calculated time."""
_KINDS: dict[int, ServoModel] = {model.number: model for model in MODELS.values()}


class FoundServo(NamedTuple):
    """One servo that answered.

    Attributes:
        id: its number.
        model: its model number.
        firmware: its version.
        baud: the line speed at which it answered.
        return_delay_us: its delay before an answer.
        hardware_error: bits, 0 if there is no error.
    """

    id: int
    model: int
    firmware: int
    baud: int
    return_delay_us: int = 0
    hardware_error: int = 0

    @property
    def kind(self) -> ServoModel | None:
        """The driver's data of the model."""
        return _KINDS.get(self.model)

    @property
    def table(self) -> ControlTable:
        """Its registers; those of most models if the model is unknown."""
        return self.kind.family.table if self.kind else ControlTable()

    @property
    def is_fast(self) -> bool:
        """Whether it answers fast reads."""
        needed = self.kind.family.fast_firmware if self.kind else None
        return needed is not None and self.firmware >= needed


def find_ports(root: Path = Path("/dev")) -> list[Path]:
    """Return serial ports that may be an adapter, persistent names first."""
    named = sorted(root.glob("serial/by-id/*"))
    known = {path.resolve() for path in named}
    plain = sorted([*root.glob("ttyUSB*"), *root.glob("ttyACM*")])
    return named + [path for path in plain if path.resolve() not in known]


def latency_timer_ms(port: Path, root: Path = Path("/sys/bus/usb-serial/devices")) -> int | None:
    """Return the latency timer of an FTDI adapter, ``None`` for other ports."""
    try:
        return int((root / port.resolve().name / "latency_timer").read_text())
    except (OSError, ValueError):
        return None


def scan(
    port: str,
    *,
    bauds: Iterable[int] = BAUD_RATES,
    ids: Sequence[int],
    wanted: Collection[int] = (),
    wait_ms: float = SCAN_WAIT_MS,
    open_bus: OpenBus = open_bus,
) -> list[FoundServo]:
    """Return every servo that answers, at any line speed.

    Args:
        port: path of the serial port.
        bauds: line speeds to try.
        ids: numbers to ask; each silent one costs some milliseconds per line speed.
        wanted: numbers to ask again if they are silent.
        wait_ms: time for an answer; more than the adapter's latency.
        open_bus: for tests.

    Raises:
        LinkError: the port does not exist.
    """
    found: list[FoundServo] = []
    for baud in bauds:
        bus = open_bus(port, baud, wait_ms=wait_ms, glance_s=READ_WAIT_S)
        try:
            for number in ids:
                servo = _asked(bus, number, baud, ATTEMPTS if number in wanted else 1)
                found += [] if servo is None else [servo]
        finally:
            bus.close()
    return found


def _asked(bus: ServoBus, number: int, baud: int, attempts: int) -> FoundServo | None:
    """Return the servo *number*, ``None`` if it does not answer.

    Raises:
        LinkError: it answers a ping and then no more, or the port is gone.
    """
    answer = next(filter(None, (bus.ping(number) for _ in range(attempts))), None)
    if answer is None:
        return None
    found = FoundServo(number, *answer, baud)
    delay = DELAY_US * bus.read(number, found.table.return_delay)
    error = bus.read(number, found.table.hardware_error)
    return found._replace(return_delay_us=delay, hardware_error=error)


def cycle_ms(servos: Sequence[FoundServo], baud: int, *, latency_ms: float = 1.0) -> float:
    """Return the calculated duration of a cycle with one write and one read.

    Args:
        servos: all on the bus; the driver sets their return delay to 0 when it starts.
        baud: line speed.
        latency_ms: the adapter's timer; an answer waits half of it on average.
    """
    is_fast = all(servo.is_fast for servo in servos)
    wire = cycle_bytes(len(servos), is_fast=is_fast) * 1e4 / baud
    return wire + len(servos) * _TURNAROUND_MS + latency_ms / 2 + _HOST_MS


def measure_cycle_ms(
    bus: ServoBus,
    servos: Sequence[FoundServo],
    count: int = 50,
    *,
    now_ns: Callable[[], int] = time.monotonic_ns,
) -> float:
    """Return the median time of a group read of current, velocity and position.

    Raises:
        LinkError: the port is gone, or no read was complete.
    """
    rows = [Row(servo.id, servo.table.current.address, 10) for servo in servos]
    is_fast = all(servo.is_fast for servo in servos)
    spans = []
    for _ in range(count):
        start = now_ns()
        bus.request(rows, is_fast=is_fast)
        blocks, _ = bus.collect(rows, 20.0, is_fast=is_fast)
        if len(blocks) == len(rows):
            spans.append((now_ns() - start) * 1e-6)
    if not spans:
        raise LinkError(f"not one of {count} group reads came back whole")
    return median_high(spans)


def diagnose(options: GimbalOptions, period: float, open_bus: OpenBus) -> list[Finding]:
    """Return the findings about the bus of *options*; changes nothing.

    Args:
        options: of the deployment.
        period: of its cycle, s.
        open_bus: opens the port.
    """
    port = Path(options.port)
    adapters = ", ".join(map(str, find_ports())) or "none"
    if not port.exists():
        text = f"{port} is not there; adapters: {adapters}"
        mend = "plug the adapter in, or name one of these as port"
        return [Finding("port", text, Verdict.PROBLEM, mend)]
    timer = latency_timer_ms(port)
    found = [Finding("port", f"{port} is there; adapters: {adapters}", Verdict.OK), _timer(timer)]
    wanted = {axis.id: axis for axis in options.axes}
    wait = max(SCAN_WAIT_MS, options.latency_ms, timer or 0.0)
    try:
        # First at the daemon's speed: a port in use is not touched further.
        servos = scan(
            options.port, bauds=[options.baud], ids=sorted({*range(_IDS), *wanted}),
            wanted=wanted, wait_ms=wait, open_bus=open_bus,
        )  # fmt: skip
        missing = sorted(wanted.keys() - {servo.id for servo in servos})
        if missing:
            others = [baud for baud in BAUD_RATES if baud != options.baud]
            servos += scan(options.port, bauds=others, ids=missing, wait_ms=wait, open_bus=open_bus)
        bus = open_bus(options.port, options.baud, wait_ms=wait, glance_s=READ_WAIT_S)
        try:
            found += [_servo(servo, options, bus) for servo in servos]
            ours = [one for one in servos if one.id in wanted and one.baud == options.baud]
            if len(ours) == len(wanted):
                found.append(_rate(ours, options, period, timer, bus))
        finally:
            bus.close()
        for number in sorted(set(missing) - {servo.id for servo in servos}):
            text, mend = "does not answer at any line speed", "look at cable, supply and id"
            found.append(Finding(f"servo {number}", text, Verdict.PROBLEM, mend))
    except DeviceError as error:
        is_link = isinstance(error, LinkError)
        mend = "is a daemon using it? end it first" if is_link else "look at cable and supply"
        found.append(Finding("bus", str(error), Verdict.PROBLEM, mend))
    return found


def _timer(timer_ms: int | None) -> Finding:
    if timer_ms is None:
        return Finding("latency timer", "not told for this port", Verdict.OK)
    if timer_ms <= _GOOD_TIMER_MS:
        return Finding("latency timer", f"{timer_ms} ms", Verdict.OK)
    mend = (
        "write 1 to its latency_timer under /sys/bus/usb-serial/devices, with a udev rule to "
        "keep it, and set latency_ms"
    )
    return Finding("latency timer", f"{timer_ms} ms", Verdict.IMPROVE, mend)


def _servo(found: FoundServo, options: GimbalOptions, bus: ServoBus) -> Finding:
    """Return the finding about a servo, with the first remedy."""
    name = found.kind.name if found.kind else f"model {found.model}, which is not known"
    text = (
        f"{name}, firmware {found.firmware}, {found.baud} baud, return delay "
        f"{found.return_delay_us} us"
    )
    axis = next((axis for axis in options.axes if axis.id == found.id), None)
    if axis is None:
        return Finding(f"servo {found.id}", f"{text}; not configured", Verdict.OK)
    servo, verdict, mend = Servo(axis), Verdict.PROBLEM, ""
    if found.hardware_error:
        text = f"{text}; reports {explain_error(found.hardware_error)}"
        mend = "a reset starts it again; find out why it happened"
    elif found.baud != options.baud:
        mend = f"configured are {options.baud} baud: set the servo or `baud`"
    elif found.model != axis.model.number:
        mend = f"configured is {axis.model.name}"
    else:
        servo.bus = bus
        own = servo.foreign()
        if refused := sorted(own.keys() - options.overwrite):
            text += "; its own " + ", ".join(f"{setting} {own[setting][0]}" for setting in refused)
            mend = f"put it right with the vendor's wizard, or set overwrite = {refused}"
        elif found.baud < _GOOD_BAUD:
            verdict, mend = Verdict.IMPROVE, f"a line speed of {_GOOD_BAUD} baud is quicker"
        elif axis.model.family.fast_firmware and not found.is_fast:
            verdict, mend = Verdict.IMPROVE, "update its firmware, which knows no fast reads"
    return Finding(str(servo), text, verdict if mend else Verdict.OK, mend)


def _rate(
    servos: list[FoundServo], options: GimbalOptions, period: float, timer: int | None,
    bus: ServoBus,
) -> Finding:  # fmt: skip
    """Return the highest rate of the bus, compared with the configured one."""
    cycle = cycle_ms(servos, options.baud, latency_ms=_GOOD_TIMER_MS if timer is None else timer)
    safe = 1e3 * _SAFE_SHARE / cycle
    text = (
        f"{safe:.0f} Hz with room to spare (a cycle of {cycle:.2f} ms, calculated); a read of all "
        f"takes {measure_cycle_ms(bus, servos):.2f} ms now, measured; configured are "
        f"{1 / period:.0f} Hz"
    )
    if 1 / period <= safe:
        return Finding("rate", text, Verdict.OK)
    mend = f"set rate_hz to {safe:.0f} or less, or the servos to a higher line speed"
    return Finding("rate", text, Verdict.IMPROVE, mend)
