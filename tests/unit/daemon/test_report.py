"""The daemon's reports about its devices: no cycle twice, none invented."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from fake_device import STATISTICS, FakeDevice, cycle

from orientd import config
from orientd.daemon.calls import report
from orientd.daemon.device import MoveOptions, QueuedMotion
from orientd.daemon.planners import reporting
from orientd.model.limits import DEFAULT_LIMITS
from orientd.model.request import Keyframe, MotionRequest
from orientd.planner.planning import plan
from orientd.planner.state import State
from orientd.protocol import control_pb2 as pb
from orientd.stream.records import CycleFlag, record_index

SETTINGS = config.default_settings().devices["arm"]


@pytest.fixture
def device():
    return FakeDevice(SETTINGS)


@pytest.fixture
def motion():
    request = MotionRequest([Keyframe((1.0, 0.0, 0.0, 0.0)), Keyframe((0.8, 0.6, 0.0, 0.0))])
    start = State.at_rest((1.0, 0.0, 0.0, 0.0))
    return plan(request, start=start, limits=DEFAULT_LIMITS, period=0.002)


def test_cycles_are_read_once_and_in_order(device):
    reader = report.CycleReader(device)
    assert reader.read() == ([], 0)
    device.published += [cycle(1), cycle(2)]
    assert reader.read() == ([cycle(1), cycle(2)], 0)
    device.published.append(cycle(3))
    assert reader.read() == ([cycle(3)], 0)
    assert reader.read() == ([], 0)


def test_cycles_that_were_gone_are_counted(device):
    reader = report.CycleReader(device)
    device.published = [cycle(5), cycle(6)]
    assert reader.read() == ([cycle(5), cycle(6)], 4)


def test_a_new_servo_counts_from_the_beginning(device):
    device.published = [cycle(1000)]
    reader = report.CycleReader(device)
    device.published = []
    assert reader.read() == ([], 0)
    device.published = [cycle(0), cycle(1)]
    assert reader.read() == ([cycle(0), cycle(1)], 0)


def test_more_cycles_than_one_reading_takes_are_all_read(device):
    reader = report.CycleReader(device)
    device.published = [cycle(k) for k in range(1, 10_001)]
    cycles, lost = reader.read()
    assert (len(cycles), lost) == (10_000, 0)


def test_who_is_behind_reads_on_where_a_full_batch_ended(device):
    reader = report.CycleReader(device)
    device.published = [cycle(k) for k in range(1, 8)]
    batches = [reader.read_records(3) for _ in range(4)]
    assert [([record_index(one) for one in records], lost) for records, lost in batches] == [
        ([1, 2, 3], 0),
        ([4, 5, 6], 0),
        ([7], 0),
        ([], 0),
    ]


def test_progress_tells_the_worst_lateness_since_the_last(device, motion):
    device.motion = planned = SimpleNamespace(facts=motion.facts, frame=None)
    reader = report.ProgressReader(device, QueuedMotion(planned, number=1))
    device.published += [cycle(1, lateness_ns=5), cycle(2, lateness_ns=900), cycle(3, overruns=2)]
    progress = reader.read()
    assert progress.lateness == pytest.approx(900e-9)
    assert progress.overruns == 2
    assert progress.duration == motion.duration
    assert not progress.HasField("tracking_error")
    assert reader.read().lateness == 0.0
    device.published = []
    assert reader.read() is None


def test_progress_is_not_that_of_a_servo_which_has_started_again(device, motion):
    planned = SimpleNamespace(facts=motion.facts, frame=None)
    device.published.append(cycle(1, overruns=2))
    reader = report.ProgressReader(device, QueuedMotion(planned, number=1))
    assert reader.read().overruns == 0
    device.servo_pid, device.published = 2, [cycle(0)]
    assert reader.read() is None


def test_a_motion_that_was_left_for_another_tells_nothing_of_the_other(device, motion):
    device.number = 2
    planned = SimpleNamespace(facts=motion.facts, frame=None)
    left, present = (
        report.ProgressReader(device, QueuedMotion(planned, number=number)) for number in (1, 2)
    )
    assert left.read() is None
    assert present.read() is not None


def test_samples_begin_and_end_with_the_motion(motion):
    for rate_hz in (500.0, 33.3, 7.0):
        samples = reporting.samples_of(motion, rate_hz)
        assert samples.times[0] == 0.0
        assert samples.times[-1] == pytest.approx(motion.duration, abs=1e-9)
        assert np.all(np.diff(samples.times) > 1e-9)
        np.testing.assert_array_equal(samples.q, motion.sample(samples.times).q)


class Meter:
    """What was measured of a motion."""

    def __init__(self, measured=None, began_ns=None):
        self.statistics, self.began_ns = lambda: measured, began_ns


def test_a_summary_has_what_was_measured_of_its_motion():
    for measured in (STATISTICS, None):
        run = QueuedMotion(number=1, meter=measured and Meter(measured))
        run.ended.set_result((pb.OUTCOME_STOPPED, "why"))
        summary = report.summary(run, [])
        assert (summary.outcome, summary.text) == (pb.OUTCOME_STOPPED, "why")
        assert summary.HasField("statistics") == (measured is not None)
        assert summary.statistics.cycles == (7 if measured else 0)


def test_motions_with_one_start_time_are_compared():
    start_ns = 5_000_000_000
    began = [start_ns + 3_000, start_ns + 11_000]
    devices = [SimpleNamespace(began_ns={start_ns: one}.get) for one in began]
    for one, lateness in zip(began, (3e-6, 11e-6), strict=True):
        run = QueuedMotion(options=MoveOptions(start_ns=start_ns), meter=Meter(began_ns=one))
        run.ended.set_result((pb.OUTCOME_DONE, ""))
        summary = report.summary(run, devices)
        assert summary.start_lateness == pytest.approx(lateness)
        assert summary.start_skew == pytest.approx(8e-6)


def test_a_device_without_cycles_or_motion_can_be_told(device):
    device.published = []
    told = report.device_report(device)
    assert (told.HasField("cycle"), told.motion_id, told.duration) == (False, "", 0.0)
    assert told.state == pb.STATE_HOLDING


def test_the_motion_that_ended_last_is_told_with_its_end(device, motion):
    queued = QueuedMotion(SimpleNamespace(facts=replace(motion.facts, name="fetch")), number=3)
    queued.reached = 0.25
    queued.ended.set_result((pb.OUTCOME_STOPPED, "stopped by ana"))
    assert not report.device_report(device).HasField("ended")
    device.last_ended = queued
    told = report.device_report(device).ended
    assert (told.motion_number, told.name, told.outcome) == (3, "fetch", pb.OUTCOME_STOPPED)
    assert (told.text, told.path_time, told.duration) == (
        "stopped by ana", 0.25, motion.facts.duration,
    )  # fmt: skip


def test_a_cycle_without_feedback_reports_none():
    told = report.cycle_message(cycle(3))
    assert not told.HasField("feedback_q")
    assert (told.index, told.state, told.fault) == (3, pb.STATE_HOLDING, pb.FAULT_NONE)


def test_a_cycle_reports_its_feedback_and_the_angle_to_it():
    half = 0.5**0.5
    fed = replace(cycle(3), flags=CycleFlag.FEEDBACK, feedback_q=(half, half, 0.0, 0.0))
    told = report.cycle_message(fed)
    assert told.tracking_error == pytest.approx(np.pi / 2)
    assert told.feedback_q.x == half
