"""The range of limits, periods and durations: what is outside of it is refused by name."""

import math
import os

import numpy as np
import pytest

import orientd
from orientd import config
from orientd.errors import ConfigError, OrientdError, RequestError
from orientd.model.limits import DEFAULT_LIMITS, Limits
from orientd.motion_file import parse
from orientd.planner.planning import plan
from orientd.planner.state import State

CASES = int(os.environ.get("ORIENTD_CASES", "40"))
TURN = [
    orientd.Quaternion(w=1.0, x=0.0, y=0.0, z=0.0),
    orientd.Quaternion(w=math.cos(0.5), x=0.0, y=0.0, z=math.sin(0.5)),
]

OUTSIDE = [
    ("velocity", 1e-300),
    ("velocity", 1e-10),
    ("acceleration", 1e13),
    ("jerk", 1e300),
    ("linear_velocity", 1e-12),
]


@pytest.mark.parametrize(("name", "limit"), OUTSIDE)
def test_a_limit_out_of_range_is_refused_by_its_name(name, limit):
    with pytest.raises(RequestError, match="must be within 1e-09 and 1e\\+12") as caught:
        orientd.plan(TURN, limits={name: limit})
    assert caught.value.field == f"limits.{name}"


@pytest.mark.parametrize(("name", "limit"), OUTSIDE)
def test_a_configuration_out_of_range_is_refused_by_its_name(name, limit):
    arm = {"driver": "loopback", "limits": {name: limit}}
    with pytest.raises(ConfigError, match=f"devices.arm.limits.{name}: must be within 1e-09"):
        config.parse({"devices": {"arm": arm}}, source="test")


def test_a_motion_file_out_of_range_is_refused_by_its_name():
    keyframes = [{"rotation_vector": [0, 0, 0]}, {"rotation_vector": [0, 0, 1]}]
    request = parse({"keyframes": keyframes, "limits": {"velocity": 1e-12}})
    start = State.at_rest((1.0, 0.0, 0.0, 0.0))
    with pytest.raises(RequestError, match="must be within 1e-09") as caught:
        plan(request, start=start, limits=DEFAULT_LIMITS, period=0.002)
    assert caught.value.field == "limits.velocity"


@pytest.mark.parametrize("velocity", [3000.0, [1.0, 1.0, 1600.0]])
def test_more_than_half_a_turn_in_a_cycle_is_refused(velocity):
    with pytest.raises(RequestError, match=r"at most half a turn in a cycle, 1570\.8 rad/s"):
        orientd.plan(TURN, limits={"velocity": velocity})
    arm = {"driver": "loopback", "limits": {"velocity": velocity}}
    with pytest.raises(ConfigError, match=r"devices.arm.limits.velocity: .* half a turn"):
        config.parse({"devices": {"arm": arm}}, source="test")


@pytest.mark.parametrize("rates", [(1e6, 1e9, 1e12), (1e5, 1e8, 1e11)])
def test_very_high_limits_with_an_end_velocity_are_refused(rates):
    keys = [TURN[0], orientd.Quaternion(w=0.6, x=0.8, y=0.0, z=0.0)]
    limits = Limits(*rates, 1.0, 10.0)
    with pytest.raises(RequestError, match="at most half a turn in a cycle") as caught:
        orientd.plan(keys, limits=limits, end_velocity=[0.0, 0.0, 50.0])
    assert caught.value.field == "limits.velocity"


def test_high_limits_with_an_end_velocity_are_planned():
    keys = [TURN[0], orientd.Quaternion(w=0.6, x=0.8, y=0.0, z=0.0)]
    limits = Limits(1e3, 1e6, 1e9, 1.0, 10.0)
    motion = orientd.plan(keys, limits=limits, end_velocity=[0.0, 0.0, 50.0])
    assert motion.certificate.end_velocity_error < 1e-9


def test_no_limits_are_the_default_ones():
    assert orientd.plan(TURN, limits=None).limits == DEFAULT_LIMITS


@pytest.mark.parametrize("period", [0.0, 1e-6, 1.5])
def test_a_period_out_of_range_is_refused(period):
    with pytest.raises(ValueError, match="period must be within"):
        orientd.plan(TURN, period=period)


def shortest(limits):
    """Return about how long a turn of 1 rad takes, s."""
    velocity, acceleration, jerk = limits.values()
    return max(1.0 / velocity, 2.0 / math.sqrt(acceleration), math.cbrt(32.0 / jerk))


@pytest.mark.timeout(900)
def test_random_limits_of_the_whole_range_are_planned_or_refused_by_a_typed_error():
    rng = np.random.default_rng(37)
    planned = count = 0
    for _ in range(CASES):
        low, high = np.sort(rng.uniform(-12.0, 15.0, 2))
        names = ("velocity", "acceleration", "jerk")
        limits = {name: 10.0 ** rng.uniform(low, high) for name in names}
        limits = {name: math.inf if rng.random() < 0.1 else x for name, x in limits.items()}
        if 100.0 < shortest(limits) < 1e5:
            continue  # hours of records, each of which is looked at
        period = float(10.0 ** rng.uniform(-4.0, -1.0))
        count += 1
        keys = TURN[rng.integers(2) :]
        start = State.at_rest((1.0, 0.0, 0.0, 0.0))
        ends = {"end_velocity": [0.0, 0.0, 10.0 ** rng.uniform(low, high)]}
        fields = ends if rng.random() < 0.3 else {}
        try:
            motion = orientd.plan(keys, limits=limits, period=period, start=start, **fields)
        except OrientdError:
            continue
        planned += 1
        assert math.isfinite(motion.duration)
        for name, limit in limits.items():
            peak = getattr(motion.certificate, f"peak_{name}").value
            assert peak <= 1.0011 * limit
    print(f"\n{planned} of {count} planned")
    assert planned >= 0.1 * count
