"""Durations change with the limits by no more than the limits do: no cliffs, and monotone."""

import math
import os

import numpy as np
import pytest

from orientd import kernels
from orientd.errors import OrientdError
from orientd.model.limits import DEFAULT_LIMITS
from orientd.model.request import Keyframe, MotionRequest
from orientd.planner.planning import plan
from orientd.planner.state import State
from orientd.planner.timing.axis_turn import usable
from orientd.rotation import exp, multiply

PERIOD = 0.002
CASES = int(os.environ.get("ORIENTD_CASES", "6"))
REST = State.at_rest((1.0, 0.0, 0.0, 0.0))
HERE = Keyframe((1.0, 0.0, 0.0, 0.0))


def about_z(rad):
    return Keyframe((math.cos(rad / 2.0), 0.0, 0.0, math.sin(rad / 2.0)))


def planned(keyframes, period=PERIOD, **rates):
    limits = DEFAULT_LIMITS.with_rates(rates)
    return plan(MotionRequest(keyframes), start=REST, limits=limits, period=period)


def alone_or_not():
    return pytest.mark.parametrize("keyframes", [[], [HERE]], ids=["one keyframe", "two"])


@alone_or_not()
@pytest.mark.parametrize("acceleration", [0.12, 0.1, 0.08, 0.05, 0.02])
@pytest.mark.parametrize("rises", [None, 0.2])
def test_a_turn_of_more_than_six_seconds_uses_all_of_its_acceleration(
    keyframes, acceleration, rises
):
    rates = {"acceleration": acceleration}
    if rises:
        rates["jerk"] = acceleration / rises
    motion = planned([*keyframes, about_z(1.0)], 0.01, **rates)
    rise, hold, cruise = kernels.double_s(1.0, 2.5, acceleration, rates.get("jerk", math.inf))
    ideal = 4.0 * rise + 2.0 * hold + cruise
    assert motion.duration <= 1.0103 * ideal
    assert not motion.certificate.notes


@alone_or_not()
def test_what_is_slower_so_that_it_can_be_stopped_says_so(keyframes):
    motion = planned([*keyframes, about_z(1.0)], 0.02, acceleration=0.001)
    assert motion.certificate.stop_time <= 24.5
    assert any(note.startswith("slower than its limits") for note in motion.certificate.notes)


@pytest.mark.parametrize("is_part", [False, True])
@pytest.mark.parametrize(
    "limits", [(math.inf, 0.001, 1.0), (2.5, 0.001, math.inf), (math.inf, 0.01, math.inf)]
)
def test_a_slow_device_without_a_limit_uses_as_much_as_with_a_high_one(limits, is_part):
    found = usable(1.0, *limits, is_part=is_part)
    high = usable(1.0, *(min(limit, 1e9) for limit in limits), is_part=is_part)
    assert found[:2] == pytest.approx(high[:2], rel=1e-6)
    assert found[2] == pytest.approx(high[2]) or (found[2] == math.inf and high[2] > 1e8)


@alone_or_not()
@pytest.mark.parametrize("velocity", [7.27e-5, 0.001, 0.00245, 0.0053, 0.01, 0.0122, 0.0151])
def test_a_slow_velocity_takes_the_way_over_the_velocity(keyframes, velocity):
    motion = planned([*keyframes, about_z(0.05)], velocity=velocity)
    assert motion.duration <= 0.05 / velocity * 1.0005 + 20 * PERIOD
    assert not motion.certificate.notes


@alone_or_not()
@pytest.mark.parametrize("name", ["acceleration", "jerk"])
def test_an_infinite_limit_is_no_slower_than_a_very_high_one(keyframes, name):
    high, infinite = (planned([*keyframes, about_z(1.0)], **{name: x}) for x in (1e9, math.inf))
    assert infinite.duration <= high.duration + 1e-9


@alone_or_not()
def test_a_jerk_beyond_all_use_is_no_slower(keyframes):
    rates = {"velocity": 4.54, "acceleration": 28.0}
    high, higher = (
        planned([*keyframes, about_z(0.718599)], jerk=jerk, **rates) for jerk in (1e9, 1e12)
    )
    assert higher.duration <= high.duration + 1e-9


SLACK = 0.002
"""Of a turn: what is drawn between two records depends on where they fall."""

SEARCHED = 0.02
"""Of a curve through keyframes, whose times are found by a search."""


def drawn(rng):
    """Return random keyframes, a limit to change, and the others."""
    count = int(rng.choice([1, 2, 3, 6]))
    keys = [np.array([1.0, 0.0, 0.0, 0.0])]
    for _ in range(count):
        turn = rng.normal(size=3)
        turn *= rng.uniform(0.1, 1.5) / np.linalg.norm(turn)
        keys.append(multiply(keys[-1], exp(turn)))
    keyframes = [Keyframe(tuple(q.tolist())) for q in (keys[1:] if count == 1 else keys)]
    rates = {"velocity": 2.5, "acceleration": 17.0, "jerk": 8500.0}
    rates = {name: rate * 10.0 ** rng.uniform(-0.5, 0.5) for name, rate in rates.items()}
    return keyframes, str(rng.choice(list(rates))), rates


@pytest.mark.timeout(900)
def test_durations_are_monotone_in_every_limit_over_six_decades():
    rng = np.random.default_rng(37)
    worst, count = {True: 0.0, False: 0.0}, 0
    for _ in range(CASES):
        keyframes, name, rates = drawn(rng)
        before = math.inf
        for factor in 10.0 ** (np.linspace(-3.0, 3.0, 9) + rng.uniform(-0.3, 0.3)):
            limits = {**rates, name: rates[name] * factor}
            limits["velocity"] = min(limits["velocity"], 3.0 / PERIOD)
            try:
                duration = planned(keyframes, **limits).duration
            except OrientdError as error:
                pytest.fail(f"{name} {limits}: {error}")
            is_turn = len(keyframes) <= 2
            worst[is_turn] = max(worst[is_turn], duration / before - 1.0)
            count += 1
            before = duration
    print(f"\n{count} motions; a higher limit takes longer by at most (is one turn) {worst}")
    assert worst[True] <= SLACK
    assert worst[False] <= SEARCHED
