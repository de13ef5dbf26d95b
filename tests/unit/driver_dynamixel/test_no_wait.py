"""No cycle waits longer than declared, in whatever state, whatever the servos answer."""

import contextlib
import itertools
import random

import pytest

from emulated_dynamixel import FaultKind, ReplyFault
from orientd.driver import Setpoint
from orientd.errors import DeviceError

MOST_READS = 40
"""How often a cycle may look at the port: noise is not searched for packets byte by byte."""


def _replies(kind, servos=(1, 2, 3), **settings):
    return lambda it: [it.bus.faults.add(k, ReplyFault(kind, **settings)) for k in servos]


def _hears(make):
    """Have the port receive what *make* returns in every cycle."""

    def inject(it):
        rng, take = random.Random(1), it.bus.wire.take
        it.bus.wire.take = lambda now_ns: take(now_ns) + (make(rng) if rng.random() < 0.3 else b"")

    return inject


CAUSES = {
    "nothing": lambda it: None,
    "one silent": _replies(FaultKind.DROP, (2,)),
    "all silent": _replies(FaultKind.DROP),
    "all late": _replies(FaultKind.DELAY, delay_ns=9_000_000),
    "half answers": _replies(FaultKind.TRUNCATE),
    "one half answer": _replies(FaultKind.TRUNCATE, (1,)),
    "some damaged": _replies(FaultKind.CORRUPT, (3,), probability=0.5),
    "restarted": lambda it: it.servo(1).reboot(it.clock.now_ns(), boot_ns=0),
    "booting": lambda it: it.servo(1).reboot(it.clock.now_ns()),
    "jammed": lambda it: setattr(it.servo(1).shaft, "jammed", True),
    "garbage": _hears(lambda rng: rng.randbytes(rng.randrange(40))),
    "headers": _hears(lambda rng: b"\xff\xff\xfd\0" + rng.randbytes(rng.randrange(20))),
    "a long packet": _hears(lambda rng: b"\xff\xff\xfd\0\1\xff\3\x55" + rng.randbytes(60)),
    "a flood": _hears(lambda rng: rng.randbytes(20_000)),
}


STATES = {
    "holding": lambda it: None,
    "disabled": lambda it: it.driver.disable(),
    "free": lambda it: (it.driver.disable(), it.driver.free()),
    "at rest in a fault": lambda it: it.driver.rest_in_fault(),
}


RATES = (100, "on"), (100, "off"), (250, "off")
EACH = list(itertools.product(RATES, CAUSES, [*STATES, "moving"]))


@pytest.mark.parametrize(
    ("rate", "cause", "state"),
    # Every third of them, which has every pair of two: the others are marked.
    [pytest.param(*one, marks=[pytest.mark.slow] * (k % 3 > 0)) for k, one in enumerate(EACH)],
)
def test_no_cycle_waits_longer_than_declared(rig, cause, state, rate):
    rate_hz, fast_read = rate
    it = rig(rate_hz=rate_hz, latency_ms=16.0, fast_read=fast_read)
    it.start()
    it.run(10)
    STATES.get(state, lambda it: None)(it)
    reads, read_port = [0], it.port.readPort

    def counted(length):
        reads[0] += 1
        return read_port(length)

    it.port.readPort = counted
    longest, is_resting = 0, False
    for k in range(rate_hz + 100):
        if k == 20:
            CAUSES[cause](it)
        if state == "moving":
            it.joints = (0.02 * (k % 50), 0.0, 0.0)
        it.clock.advance(it.period_ns)
        begun, reads[0] = it.clock.now_ns(), 0
        try:
            it.driver.read()
        except DeviceError:
            if k > 120 and not is_resting:
                it.driver.rest_in_fault()
                is_resting = True
        if state not in {"disabled", "free"}:
            with contextlib.suppress(DeviceError):
                it.driver.write(Setpoint(begun, it.q, joints=it.joints))
        it.driver.health(), it.driver.notices(), it.driver.gaps()
        longest = max(longest, it.clock.now_ns() - begun)
        assert reads[0] <= MOST_READS
    assert longest <= it.driver.longest_call * 1e9
    assert it.driver.longest_call <= 0.6 / rate_hz + 1e-9
