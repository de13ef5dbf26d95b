"""Effects of a pace, a duration and nearly equal keyframes on a motion."""

import math

import numpy as np
import pytest
from planned import LIMITS, PERIOD, rotations
from reference.ruckig_turn import fastest
from scipy.spatial.transform import Rotation

import orientd
from orientd.errors import PlanError, RequestError
from orientd.model.request import Keyframe, MotionRequest
from orientd.planner.planning import plan
from orientd.planner.state import State
from orientd.planner.timing.profiles import aimed_at

ARM = LIMITS["arm"]
KEYS = rotations(np.random.default_rng(3), 5, 0.8)


def made(keys=KEYS, **fields):
    request = MotionRequest([Keyframe(tuple(q)) for q in keys], **fields)
    return plan(request, start=State.at_rest(KEYS[0]), limits=ARM, period=PERIOD)


def beside(q, distance):
    turned = Rotation.from_quat(np.array(q)[[1, 2, 3, 0]]) * Rotation.from_rotvec([0, distance, 0])
    return turned.as_quat()[[3, 0, 1, 2]].tolist()


def test_a_share_of_the_pace_takes_as_much_longer():
    assert made(pace=0.6).duration == pytest.approx(made().duration / 0.6, rel=2e-3)
    assert made(pace="even").duration > 1.1 * made().duration


def test_a_duration_is_kept_or_refused():
    assert made(duration=5.0).duration == pytest.approx(5.0, abs=1e-9)
    with pytest.raises(PlanError, match=r"take at least 1\..* got a duration of 1 s"):
        made(duration=1.0)
    with pytest.raises(RequestError, match="a share of the full speed has its own duration"):
        made(duration=5.0, pace=0.5)


@pytest.mark.parametrize("limits", ["arm", "soft"])
def test_a_single_keyframe_takes_as_long_as_with_ruckig(limits):
    limits = LIMITS[limits]
    used = aimed_at(limits)
    took = fastest(0.8, used.velocity, used.acceleration, used.jerk)
    motion = plan(
        MotionRequest([Keyframe(KEYS[1])]),
        start=State.at_rest(KEYS[0]),
        limits=limits,
        period=PERIOD,
    )
    assert motion.duration == pytest.approx(took, rel=1e-9)


@pytest.mark.parametrize("place", [0, 2, 4])
def test_a_keyframe_beside_another_one_costs_no_more_than_one_farther_off(place):
    durations = []
    for distance in (0.0, 1e-12, 1e-8, 1e-6, 1e-4, 1e-3, 1e-2, 1e-1):
        keys = [*KEYS[: place + 1], beside(KEYS[place], distance), *KEYS[place + 1 :]]
        durations.append(made(keys).duration)
    assert all(
        one <= 1.1 * later for k, one in enumerate(durations) for later in durations[k + 1 :]
    )


def test_keyframes_that_are_passed_as_one_are_noted():
    motion = made([*KEYS, beside(KEYS[-1], 1e-4)])
    assert motion.certificate.notes == (
        "keyframes[4] is 0.0001 rad from keyframes[5]: passed as one",
    )
    assert motion.certificate.keyframe_error == pytest.approx(1e-4, rel=1e-6)
    assert math.isclose(motion.keyframe_times[4], motion.keyframe_times[5])


@pytest.mark.parametrize("count", [1, 3])
@pytest.mark.parametrize("pace", [0.5, 0.1])
def test_a_device_that_moves_takes_up_a_slower_pace(pace, count):
    random = np.random.default_rng(5)
    for _ in range(10):
        first = orientd.plan(Rotation.random(2, rng=random))
        start = first.state_at(int(random.integers(5, first.record_count - 5)))
        keys = Rotation.random(count, rng=random)
        motion = orientd.plan(keys, start=start, approach=True, pace=pace)
        assert motion.certificate.keyframe_error < 1e-9
        q = np.concatenate([start.before[0], motion.rows(0, motion.record_count)[:, :4]])
        turned = Rotation.from_quat(q[:, [1, 2, 3, 0]])
        rates = (turned[:-1].inv() * turned[1:]).as_rotvec() / motion.period
        for most in (ARM.velocity, ARM.acceleration, ARM.jerk):
            assert np.linalg.norm(rates, axis=1).max() <= 1.000001 * most
            rates = np.diff(rates, axis=0) / motion.period


@pytest.mark.parametrize(
    "fields", [{"end_velocity": (0.0, 0.0, 1.5)}, {"start_velocity": (0.0, 1.5, 0.0)}]
)
def test_a_refusal_for_the_pace_names_the_pace(fields):
    with pytest.raises(PlanError, match=r"a pace of 0\.1 leaves 10 % of the velocity") as got:
        made(pace=0.1, approach=True, **fields)
    assert "the limit is 0.25 rad/s" in str(got.value)


def test_other_refusals_do_not_name_the_pace():
    with pytest.raises(PlanError) as caught:
        made([beside(KEYS[0], 0.3), KEYS[1]], pace=0.1)
    assert "pace" not in str(caught.value)
