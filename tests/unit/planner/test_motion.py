import numpy as np
import pytest
from planned import LIMITS, PERIOD, random_motions, times_of

from orientd.stream.records import PATH_FLOATS

MOTIONS = random_motions(77, 4, LIMITS["arm"])
MOTION = MOTIONS[0]


def test_samples_do_not_depend_on_the_block_they_are_taken_in():
    times = times_of(MOTION)
    whole = MOTION.sample(times)
    shuffled = np.random.default_rng(1).permutation(len(times))
    for part, again in zip(whole, MOTION.sample(times[shuffled]), strict=True):
        assert again == pytest.approx(part[shuffled], abs=1e-12)
    for first in range(0, len(times), 97):
        for part, again in zip(whole, MOTION.sample(times[first : first + 97]), strict=True):
            assert again == pytest.approx(part[first : first + 97], abs=1e-12)


def test_one_sample_is_a_block_of_one():
    q, omega, *_ = MOTION.sample([0.5 * MOTION.duration])
    assert q.shape == (1, 4)
    assert omega.shape == (1, 3)


def test_no_samples_are_an_empty_block():
    assert [part.shape for part in MOTION.sample([])] == [(0, 4), (0, 3), (0, 3), (0, 3), (0, 3)]


def test_samples_take_one_dimension_of_times():
    with pytest.raises(ValueError, match="one-dimensional"):
        MOTION.sample([[0.0]])


def test_instants_that_are_not_numbers_are_refused():
    for times in ([np.nan], [0.0, np.nan, 0.1], [0.2, np.nan, 0.1]):
        with pytest.raises(ValueError, match="must be numbers"):
            MOTION.sample(times)


@pytest.mark.parametrize("motion", MOTIONS)
def test_a_motion_is_held_before_and_after(motion):
    held = motion.sample([-10.0, -1e-6, motion.duration, motion.duration + 10.0])
    assert held.q[:2] == pytest.approx(np.stack([motion.path.first] * 2), abs=0)
    assert held.q[2:] == pytest.approx(np.stack([motion.path.last] * 2), abs=0)
    for rates in (held.omega_body, held.alpha_body, held.velocity):
        assert not rates.any()


def test_records_are_samples_on_the_grid_in_the_order_of_the_ring():
    first, count = MOTION.record_count // 3, 50
    records = MOTION.records(first, count)
    samples = MOTION.sample(PERIOD * np.arange(first, first + count))
    assert records.shape == (count, PATH_FLOATS)
    assert records[:, :16] == pytest.approx(np.concatenate(samples, axis=1), abs=0)
    assert np.isnan(records[:, 16:]).all()
    assert records.dtype == np.float64
    assert records.flags.c_contiguous


def test_records_that_are_not_there_are_refused():
    with pytest.raises(ValueError, match="records must be within"):
        MOTION.records(MOTION.record_count - 1, 2)
    with pytest.raises(ValueError, match="records must be within"):
        MOTION.records(-1, 2)


def test_motions_have_different_names():
    assert len({motion.id for motion in MOTIONS}) == len(MOTIONS)
