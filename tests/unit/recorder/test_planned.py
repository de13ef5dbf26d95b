"""Planned orientations: the path of a motion, and where on it each cycle was."""

import numpy as np
import pytest
from recorded import RATE_HZ, moving

from orientd import rotation
from orientd.protocol import control_pb2 as pb
from orientd.recorder.planned import marks, planned_orientations
from orientd.recorder.reader import Recording

OMEGA = np.array([0.3, -0.2, 0.5])
FIRST = 500  # path index of the first record
COUNT = 400
BEGUN = 100  # cycle in which the motion begins
STEP = 0.1  # s between samples of the path


def path(times):
    """Return orientations of a turn with constant velocity."""
    return rotation.exp(np.multiply.outer(times, OMEGA))


def started(time_ns, *, number=1, first=FIRST):
    event = pb.Event(
        device="arm", kind=pb.EVENT_KIND_MOTION_STARTED, motion_number=number, time_ns=time_ns
    )
    if first is not None:
        event.path_index = first
    for time in np.arange(11) * STEP:
        sample = event.samples.add(path_time=time)
        sample.q.w, sample.q.x, sample.q.y, sample.q.z = path(time)
        sample.omega_body.x, sample.omega_body.y, sample.omega_body.z = OMEGA
    return event


@pytest.fixture
def cycles():
    """Cycles of an earlier version; from BEGUN on of motion 1, half a record after each record."""
    table = moving(COUNT)
    table["motion"] = np.arange(COUNT) >= BEGUN
    table["path_index"] = FIRST + np.maximum(np.arange(COUNT) - BEGUN, 0)
    table["path_fraction"] = 0.5
    table["sent_q"] = path((table["path_index"] - FIRST + 0.5) / RATE_HZ)
    table["planned_q"] = np.nan
    return table


def recording(cycles, *events):
    facts = {"rates_hz": f"leg=100.0 arm={RATE_HZ!r}"}
    return Recording(cycles={"arm": cycles}, events=list(events), facts=facts)


def test_an_orientation_that_the_servo_recorded_is_not_interpolated(cycles):
    own = rotation.multiply(cycles["sent_q"], rotation.exp([1e-5, 0.0, 0.0]))
    cycles["planned_q"][BEGUN:] = own[BEGUN:]
    event = started(int(cycles["deadline_ns"][BEGUN]))
    times, planned = planned_orientations(recording(cycles, event), "arm")
    np.testing.assert_array_equal(planned[BEGUN:], own[BEGUN:])
    assert np.isnan(planned[:BEGUN]).all()
    assert np.isfinite(times[BEGUN:]).all()
    _, alone = planned_orientations(recording(cycles), "arm")
    np.testing.assert_array_equal(alone, planned)


@pytest.mark.parametrize("first", [FIRST, None], ids=["told", "found"])
def test_each_cycle_has_the_orientation_of_its_place_on_the_path(cycles, first):
    event = started(int(cycles["deadline_ns"][BEGUN]), first=first)
    times, planned = planned_orientations(recording(cycles, event), "arm")
    expected = (np.arange(COUNT - BEGUN) + 0.5) / RATE_HZ
    np.testing.assert_allclose(times[BEGUN:], expected, atol=1e-12)
    assert rotation.angle(planned[BEGUN:], path(expected)).max() < 1e-9
    assert np.isnan(times[:BEGUN]).all()
    assert np.isnan(planned[:BEGUN]).all()


def test_a_motion_that_waited_may_begin_one_record_before_its_first_cycle(cycles):
    cycles["path_index"][BEGUN:] += 1
    cycles["sent_q"][BEGUN:] = path((cycles["path_index"][BEGUN:] - FIRST + 0.5) / RATE_HZ)
    event = started(int(cycles["deadline_ns"][BEGUN]), first=None)
    times, _ = planned_orientations(recording(cycles, event), "arm")
    assert times[BEGUN] == pytest.approx(1.5 / RATE_HZ, abs=1e-12)


def test_after_its_last_sample_a_path_stays(cycles):
    cycles["path_index"][-1] = FIRST + 10_000
    event = started(int(cycles["deadline_ns"][BEGUN]))
    _, planned = planned_orientations(recording(cycles, event), "arm")
    assert float(rotation.angle(planned[-1], path(1.0))) < 1e-9


def test_cycles_of_an_earlier_run_of_the_daemon_are_not_of_the_motion(cycles):
    begun = int(cycles["deadline_ns"][BEGUN])
    for late, count in ((4_900_000_000, COUNT - BEGUN), (5_500_000_000, 50)):
        event = started(begun + late)
        moved = cycles.copy()
        moved["deadline_ns"][-50:] += 60_000_000_000
        times, _ = planned_orientations(recording(moved, event), "arm")
        assert np.count_nonzero(np.isfinite(times)) == count


def test_other_devices_and_events_without_a_path_plan_nothing(cycles):
    begun = int(cycles["deadline_ns"][BEGUN])
    other, empty, unknown = started(begun), started(begun), started(begun, number=7)
    other.device = "leg"
    del empty.samples[:]
    times, planned = planned_orientations(recording(cycles, other, empty, unknown), "arm")
    assert np.isnan(times).all()
    assert np.isnan(planned).all()


def test_a_picture_marks_what_happened_to_the_device(cycles):
    kinds = (pb.EVENT_KIND_MOTION_STARTED, pb.EVENT_KIND_RECORDED, pb.EVENT_KIND_FAULT)
    events = [pb.Event(device="arm", kind=kind, time_ns=k) for k, kind in enumerate(kinds)]
    events.append(pb.Event(device="leg", kind=pb.EVENT_KIND_FAULT, time_ns=9))
    assert marks(recording(cycles, *events), "arm") == [(0, "started"), (2, "FAULT")]


def test_without_a_rate_it_is_found_from_the_cycles(cycles):
    assert Recording(cycles={"arm": cycles}).rate_hz("arm") == pytest.approx(RATE_HZ)


def test_the_device_is_named_or_the_only_one(cycles):
    both = Recording(cycles={"leg": cycles, "arm": cycles})
    assert both.device("leg") == "leg"
    assert recording(cycles).device() == "arm"
    for name, came in (("", "no name"), ("hip", "'hip'")):
        with pytest.raises(Exception, match=f"device: expected one of arm, leg, got {came}"):
            both.device(name)
