"""Look at a bus: which servos there are, how they are set, and what stands in the way of speed.

Nothing is changed: every finding comes with what to do about it.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from statistics import median_high

from orientd.errors import DeviceError, LinkError
from orientd_dynamixel.bus import BLOCK, READ_WAIT_S, OpenBus, ServoBus, explain_error, open_bus
from orientd_dynamixel.options import BAUD_RATES, MODELS, ServoModel
from orientd_dynamixel.settings import own_settings

SCAN_WAIT_MS = 4.0
ATTEMPTS = 4
"""How often a servo is asked that should be there; an answer may be late or damaged once."""
TURNAROUND_MS = 0.05
HOST_MS = 0.3
"""What the host itself needs each cycle, on the safe side."""
SAFE_SHARE = 0.57
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
        settings: its own, which have a meaning beside orientd, by name.
    """

    id: int
    model: int
    firmware: int
    baud: int
    return_delay_us: int
    hardware_error: int
    settings: Mapping[str, int] = field(default_factory=dict)

    @property
    def name(self) -> str:
        """What is printed on it."""
        kind = _KINDS.get(self.model)
        return kind.name if kind else f"model {self.model}"

    @property
    def is_fast(self) -> bool:
        """Whether it answers fast reads."""
        kind = _KINDS.get(self.model)
        return kind is not None and self.firmware >= kind.fast_firmware


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
        wanted: numbers that are asked again where they are silent.
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
            answer = bus.ping(number)
            if answer is not None:
                return _look(bus, number, baud, answer)
        except LinkError:
            if attempt == attempts:
                raise
        except DeviceError:
            return None
    return None


def _look(bus: ServoBus, number: int, baud: int, answer: tuple[int, int]) -> FoundServo:
    return FoundServo(
        number, *answer, baud,
        return_delay_us=2 * bus.read(number, 9, 1),
        hardware_error=bus.read(number, 70, 1),
        settings=own_settings(bus, number),
    )  # fmt: skip


def cycle_ms(servos: Sequence[FoundServo], baud: int, *, latency_ms: float = 1.0) -> float:
    """Return how long a cycle of one write and one read takes, calculated.

    Args:
        servos: all on the bus.
        baud: line speed.
        latency_ms: the adapter's timer; an answer waits half of it on average.
    """
    count, block = len(servos), len(BLOCK)
    is_fast = all(servo.is_fast for servo in servos)
    answer = 8 + count * (block + 4) if is_fast else count * (block + 11)
    wire = (14 + 5 * count + 14 + count + answer) * 1e4 / baud
    turns = sum(TURNAROUND_MS + servo.return_delay_us * 1e-3 for servo in servos)
    return wire + turns + latency_ms / 2 + HOST_MS


def safe_rate_hz(servos: Sequence[FoundServo], baud: int, *, latency_ms: float = 1.0) -> float:
    """Return the cycle rate that the bus holds with room to spare, calculated."""
    return 1e3 * SAFE_SHARE / cycle_ms(servos, baud, latency_ms=latency_ms)


def measure_cycle_ms(
    bus: ServoBus,
    servos: Sequence[FoundServo],
    count: int = 50,
    *,
    now_ns: Callable[[], int] = time.monotonic_ns,
) -> float:
    """Return the median time of a group read of position and velocity; nothing is written.

    Raises:
        LinkError: the port is gone, or not one read came back whole.
    """
    rows = [(servo.id, 126, 10) for servo in servos]
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
        if servo.model not in _KINDS:
            advice.append(f"servo {servo.id} is {servo.name}, which the driver does not know")
    speeds = sorted({servo.baud for servo in servos})
    if len(speeds) > 1:
        advice.append(f"the servos are set to {speeds} baud: set all to the same")
    if speeds[0] < 1_000_000:
        advice.append(f"{speeds[0]} baud is slow: set the servos to 1000000 (register 8 := 3)")
    if any(servo.return_delay_us for servo in servos):
        advice.append("return delay is not 0: the driver sets it to 0 when it starts")
    old = [servo.id for servo in servos if servo.model in _KINDS and not servo.is_fast]
    if old:
        advice.append(f"servos {old} have firmware that knows no fast reads: update it")
    twice = {s.id for s in servos if sum(o.id == s.id for o in servos) > 1}
    if twice:
        advice.append(f"ids {sorted(twice)} are used at more than one line speed")
    return advice
