"""The emulated base turns as its rate says, and its samples are noisy, late and lost as asked."""

import itertools
import json
import math

import pytest

from emulated_base import BASES, BaseMotion, Imu, run
from orientd.floats import difference, norm

KINDS = sorted(BASES)


@pytest.mark.parametrize("kind", KINDS)
def test_the_rate_is_the_derivative_of_the_orientation(kind):
    motion, d = BaseMotion(kind, seed=3), 1e-5
    for k in range(40):
        t = 0.37 * k
        turn = difference(motion.orientation(t - d), motion.orientation(t + d))
        rate = tuple(x / (2.0 * d) for x in turn)
        assert rate == pytest.approx(motion.rate(t), abs=1e-8)


@pytest.mark.parametrize("kind", KINDS)
def test_the_motion_stays_inside_the_angles_of_its_kind_and_follows_its_seed(kind):
    motion, most = BaseMotion(kind, seed=1), sum(map(math.radians, BASES[kind].degrees))
    level = (1.0, 0.0, 0.0, 0.0)
    assert all(norm(difference(level, motion.orientation(0.1 * k))) <= most for k in range(600))
    assert motion.orientation(7.0) == BaseMotion(kind, seed=1).orientation(7.0)


def test_samples_have_noise_latency_and_dropouts():
    motion = BaseMotion("vehicle")
    imu = Imu(rate_hz=50.0, noise=1e-3, latency=0.02, jitter=0.005, dropouts=0.2, seed=4)
    samples = list(itertools.islice(imu.samples(motion), 800))
    lateness = [one.arrives - one.time for one in samples]
    assert 0.02 <= min(lateness) <= max(lateness) <= 0.025
    assert samples[-1].time == pytest.approx(800 / 0.8 / 50.0, rel=0.05)
    off = [norm(difference(one.q_world_base, motion.orientation(one.time))) for one in samples]
    assert math.sqrt(sum(x * x for x in off) / len(off) / 3.0) == pytest.approx(1e-3, rel=0.1)


def test_the_lines_have_the_time_of_the_measurement(capsys):
    run(BaseMotion("ship"), Imu(rate_hz=50.0, latency=0.0, jitter=0.0), seconds=0.1)
    lines = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert [one["time_ns"] - lines[0]["time_ns"] for one in lines] == [
        k * 20_000_000 for k in range(5)
    ]
    assert set(lines[0]["base"]["quaternion"]) == set("wxyz")


@pytest.mark.parametrize("given", [{"rate_hz": 0.0}, {"noise": -1.0}, {"dropouts": 1.5}])
def test_properties_out_of_range_are_refused(given):
    with pytest.raises(ValueError, match=next(iter(given))):
        Imu(**given)


def test_an_unknown_kind_is_refused():
    with pytest.raises(ValueError, match="expected one of ship, vehicle, rest, got 'car'"):
        BaseMotion("car")
