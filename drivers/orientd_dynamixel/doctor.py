"""Look at a deployment's bus: port, adapter, every servo, and the rate that the bus can hold.

Nothing is changed: every finding comes with what to do about it.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import median_high

from orientd.driver import Finding, Verdict
from orientd.errors import DeviceError, LinkError
from orientd_dynamixel.bus import ATTEMPTS, READ_WAIT_S, OpenBus, Row, ServoBus, open_bus
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
"""Numbers asked besides those configured: 0 to 20."""
_GOOD_TIMER_MS = 1.0
"""The adapter's timer if the machine does not tell it: what it should be set to."""
_TURNAROUND_MS = 0.05
_HOST_MS = 0.3
"""What the host itself needs each cycle, on the safe side."""
_SAFE_SHARE = 0.57
"""Share of a cycle that the bus may be busy; the model is about half as fast in the worst case."""
_KINDS: dict[int, ServoModel] = {model.number: model for model in MODELS.values()}


@dataclass(frozen=True, slots=True)
class FoundServo:
    """One servo that answered.

    Attributes:
        id: its number.
        model: its model number.
        firmware: its version.
        baud: the line speed at which it answered.
        return_delay_us: how long it waits before it answers.
        hardware_error: bits, 0 if all is well.
    """

    id: int
    model: int
    firmware: int
    baud: int
    return_delay_us: int
    hardware_error: int

    @property
    def kind(self) -> ServoModel | None:
        """What the driver knows of the model."""
        return _KINDS.get(self.model)

    @property
    def name(self) -> str:
        """What is printed on it."""
        return self.kind.name if self.kind else f"model {self.model}"

    @property
    def is_fast(self) -> bool:
        """Whether it answers fast reads."""
        needed = self.kind.family.fast_firmware if self.kind else None
        return needed is not None and self.firmware >= needed


def find_ports(root: Path = Path("/dev")) -> list[Path]:
    """Return serial ports that may be an adapter, the names that stay the same first."""
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
    ids: Sequence[int] = tuple(range(1, 21)),
    wanted: Collection[int] = (),
    wait_ms: float = SCAN_WAIT_MS,
    open_bus: OpenBus = open_bus,
) -> list[FoundServo]:
    """Return every servo that answers, at any line speed.

    Args:
        port: path of the serial port.
        bauds: line speeds to try.
        ids: numbers to ask; each that is silent costs some milliseconds a line speed.
        wanted: numbers that are asked again if they are silent.
        wait_ms: how long an answer may take; more than the adapter's latency.
        open_bus: for tests.

    Raises:
        LinkError: the port is not there.
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
    """Return what servo *number* is, ``None`` if it does not say so.

    Raises:
        LinkError: it answers a ping and then no more, or the port is gone.
    """
    for attempt in range(1, attempts + 1):
        try:
            if answer := bus.ping(number):
                kind = _KINDS.get(answer[0])
                table = kind.family.table if kind else ControlTable()
                return FoundServo(
                    number, *answer, baud, DELAY_US * bus.read(number, table.return_delay),
                    bus.read(number, table.hardware_error),
                )  # fmt: skip
        except LinkError:
            if attempt == attempts:
                raise
        except DeviceError:
            return None
    return None


def cycle_ms(servos: Sequence[FoundServo], baud: int, *, latency_ms: float = 1.0) -> float:
    """Return how long a cycle of one write and one read takes, calculated.

    Args:
        servos: all on the bus.
        baud: line speed.
        latency_ms: the adapter's timer; an answer waits half of it on average.
    """
    count, block = len(servos), len(ControlTable().block)
    is_fast = all(servo.is_fast for servo in servos)
    answer = 8 + count * (block + 4) if is_fast else count * (block + 11)
    wire = (14 + 5 * count + 14 + count + answer) * 1e4 / baud
    turns = sum(_TURNAROUND_MS + servo.return_delay_us * 1e-3 for servo in servos)
    return wire + turns + latency_ms / 2 + _HOST_MS


def safe_rate_hz(servos: Sequence[FoundServo], baud: int, *, latency_ms: float = 1.0) -> float:
    """Return the cycle rate that the bus holds with room to spare, calculated."""
    return 1e3 * _SAFE_SHARE / cycle_ms(servos, baud, latency_ms=latency_ms)


def measure_cycle_ms(
    bus: ServoBus,
    servos: Sequence[FoundServo],
    count: int = 50,
    *,
    now_ns: Callable[[], int] = time.monotonic_ns,
) -> float:
    """Return the median time of a group read of current, velocity and position.

    Raises:
        LinkError: the port is gone, or not one read came back whole.
    """
    tables = [servo.kind.family.table if servo.kind else ControlTable() for servo in servos]
    rows = [Row(s.id, table.current.address, 10) for s, table in zip(servos, tables, strict=True)]
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


def advise(servos: Sequence[FoundServo]) -> list[str]:
    """Return what to change, most important first, of *servos* as found."""
    if not servos:
        return ["no servo answers: look at supply, cable and adapter, and try more ids"]
    advice = []
    for servo in servos:
        if servo.hardware_error:
            advice.append(
                f"servo {servo.id} reports {explain_error(servo.hardware_error)}: a reset starts "
                "it again; find out why it happened"
            )
        if servo.kind is None:
            advice.append(f"servo {servo.id} is {servo.name}, which the driver does not know")
    speeds = sorted({servo.baud for servo in servos})
    if len(speeds) > 1:
        advice.append(f"the servos are set to {speeds} baud: set all to the same")
    if speeds[0] < 1_000_000:
        advice.append(f"{speeds[0]} baud is slow: set the servos to 1000000 (register 8 := 3)")
    if any(servo.return_delay_us for servo in servos):
        advice.append("return delay is not 0: the driver sets it to 0 when it starts")
    old = [s.id for s in servos if s.kind and s.kind.family.fast_firmware and not s.is_fast]
    if old:
        advice.append(f"servos {old} have firmware that knows no fast reads: update it")
    twice = {s.id for s in servos if sum(o.id == s.id for o in servos) > 1}
    if twice:
        advice.append(f"ids {sorted(twice)} are used at more than one line speed")
    return advice


def diagnose(options: GimbalOptions, period: float, open_bus: OpenBus) -> list[Finding]:
    """Return what there is to say of the bus that *options* name; changes nothing.

    Args:
        options: of the deployment.
        period: of its cycle, s.
        open_bus: opens the port.
    """
    port = Path(options.port)
    adapters = ", ".join(map(str, find_ports())) or "none"
    if not port.exists():
        mend = "plug the adapter in, or name one of these as port"
        text = f"{port} is not there; adapters: {adapters}"
        return [Finding("port", text, Verdict.PROBLEM, mend)]
    timer = latency_timer_ms(port)
    found = [
        Finding("port", f"{port} is there; adapters: {adapters}", Verdict.OK),
        _timer(timer),
    ]
    wanted = [axis.id for axis in options.axes]
    wait = max(SCAN_WAIT_MS, options.latency_ms, timer or 0.0)
    try:
        # First at the speed that the daemon would use: a port in use is not touched further.
        servos = scan(
            options.port, bauds=[options.baud], ids=sorted({*range(_IDS), *wanted}),
            wanted=wanted, wait_ms=wait, open_bus=open_bus,
        )  # fmt: skip
        missing = [number for number in wanted if number not in {one.id for one in servos}]
        if missing:
            others = [baud for baud in BAUD_RATES if baud != options.baud]
            servos += scan(options.port, bauds=others, ids=missing, wait_ms=wait, open_bus=open_bus)
        bus = open_bus(options.port, options.baud, wait_ms=wait, glance_s=READ_WAIT_S)
        try:
            found += [_servo(servo, options, bus) for servo in servos]
            for number in missing:
                if number not in {servo.id for servo in servos}:
                    text, mend = (
                        "does not answer at any line speed",
                        "look at its cable, its supply and its id",
                    )
                    found.append(Finding(f"servo {number}", text, Verdict.PROBLEM, mend))
            found += [
                Finding("bus", "can do better", Verdict.IMPROVE, one) for one in advise(servos)
            ]
            ours = [one for one in servos if one.id in wanted and one.baud == options.baud]
            if len(ours) == len(wanted):
                found.append(_rate(ours, options, period, timer, bus))
        finally:
            bus.close()
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
    axis = next((axis for axis in options.axes if axis.id == found.id), None)
    text = (
        f"{found.name}, firmware {found.firmware}, {found.baud} baud, return delay "
        f"{found.return_delay_us} us"
    )
    if axis is None:
        return Finding(f"servo {found.id}", f"{text}; not configured", Verdict.OK)
    servo, mend = Servo(axis), ""
    if found.baud != options.baud:
        mend = f"configured are {options.baud} baud: set the servo or `baud`"
    elif found.model != axis.model.number:
        mend = f"configured is {axis.model.name}"
    else:
        servo.bus = bus
        own = servo.foreign()
        if refused := sorted(own.keys() - options.overwrite):
            said = ", ".join(f"{setting} {own[setting][0]}" for setting in refused)
            text = f"{text}; its own {said}"
            mend = f"put it right with the vendor's wizard, or set overwrite = {refused}"
    return Finding(str(servo), text, Verdict.PROBLEM if mend else Verdict.OK, mend)


def _rate(
    servos: list[FoundServo],
    options: GimbalOptions,
    period: float,
    timer: int | None,
    bus: ServoBus,
) -> Finding:
    latency = _GOOD_TIMER_MS if timer is None else timer
    # The driver sets the return delay to 0 when it starts.
    tuned = [replace(one, return_delay_us=0) for one in servos]
    safe = safe_rate_hz(tuned, options.baud, latency_ms=latency)
    text = (
        f"{safe:.0f} Hz with room to spare (a cycle of "
        f"{cycle_ms(tuned, options.baud, latency_ms=latency):.2f} ms, calculated); a read of all "
        f"takes {measure_cycle_ms(bus, servos):.2f} ms now, measured; configured are "
        f"{1 / period:.0f} Hz"
    )
    if 1 / period <= safe:
        return Finding("rate", text, Verdict.OK)
    mend = f"set rate_hz to {safe:.0f} or less, or the servos to a higher line speed"
    return Finding("rate", text, Verdict.IMPROVE, mend)
