"""Changes to a gimbal's running motions: a real daemon on the emulated bus."""

import itertools
import math
import time

import numpy as np
import pytest
from gimbal_bench import EmulatedGimbal, GimbalDaemon
from harness import CycleLog, is_from_rest, until
from judge import Judge

import orientd
from orientd import rotation
from orientd.errors import LimitError, StartError
from orientd.protocol import control_pb2 as pb
from orientd.stream.records import ServoState

pytest.importorskip("dynamixel_sdk")

from orientd.driver import AxisLimits
from orientd.mechanism import Gimbal

pytestmark = pytest.mark.world

DEVICE = "gimbal"
AXIS_RATES = np.deg2rad(220), 40.0
WIDE = (
    ("limits_deg = [-100, 100]", "limits_deg = [-200, 200]"),
    ("limits_deg = [-120, 120]", "limits_deg = [-200, 200]"),
)
DEVIATION = ("max_deviation_deg = 0.0", "max_deviation_deg = 3.0")
SLEWS = (
    ("# allow_slews = true ", "allow_slews = true "),
    ("limits_deg = [-270, 270]", "limits_deg = [-100, 100]"),
)
QUICK = (
    ("velocity = 1.5 ", "velocity = 3.5 "),
    ("acceleration = 8 ", "acceleration = 30 "),
    ("jerk = 1500 ", "jerk = 5000 "),
)


class Watched:
    """A robot on the emulated bus, with every cycle of its servo."""

    def __init__(self, folder, *changes):
        self.bus = EmulatedGimbal(folder / "bus")
        self.daemon = GimbalDaemon(folder, self.bus.link, *WIDE, *changes).start()
        self.robot = orientd.connect(self.daemon.socket)
        self.log = CycleLog(self.daemon.socket)

    def end(self):
        self.log.close()
        self.robot.close()
        self.daemon.end()
        self.bus.end()

    @property
    def report(self):
        return self.robot.state().devices[DEVICE]

    def pitch(self):
        """Return the angle of pitch as measured, deg."""
        return (self.bus.state(2)["position"] - 2048) * 360 / 4096


@pytest.fixture
def gimbal(request, tmp_path):
    it = Watched(tmp_path, *getattr(request, "param", (DEVIATION,)))
    yield it
    it.end()


def key(*vector):
    w, x, y, z = rotation.exp(np.array(vector, float)).tolist()
    return orientd.Quaternion(w=w, x=x, y=y, z=z)


def over_the_top(miss_deg=2.0):
    """Return a motion that turns over from 60 to 150 degrees, missing the pole.

    It is so slow that a new motion, planned on a busy machine, still begins near the pole.
    """
    miss = np.deg2rad(miss_deg)
    axis = np.array([0, -np.cos(miss), np.sin(miss)])
    return [
        {"rotation_vector": (np.deg2rad(sweep) * axis).tolist(), "time": (sweep - 60) / 7.5}
        for sweep in np.linspace(60, 150, 5)
    ]


def round_and_round(turns=4):
    """Return a motion in circles that does not end before a busy machine has planned another."""
    quarters = np.arange(4 * turns) * np.pi / 2
    return [key(0, -0.6 * np.sin(quarter), 1.0 - np.cos(quarter)) for quarter in quarters]


def axes_of(cycles):
    """Return the axis angles that the driver made of what was sent, unwrapped, from 0 on."""
    gimbal = Gimbal([AxisLimits(name, -7.0, 7.0, 4.0) for name in "abc"])
    rows = [(0.0, 0.0, 0.0)]
    for cycle in cycles:
        rows.append(gimbal.solve(cycle.q, rows[-1])[0])
    return np.array(rows[1:])


def assert_smooth(cycles, *, velocity=1.5, acceleration=8.0):
    """Check that axes and orientation kept their limits, over all that was sent."""
    violations, period = [], 1e-2
    limits = {"velocity": velocity, "acceleration": acceleration}
    judge = Judge(limits, period, violations.append)
    judge.axes = [AxisLimits(name, -7.0, 7.0, *AXIS_RATES) for name in "abc"]
    judge.begin_in_motion()
    before = cycles[0]
    for cycle, axes in zip(cycles, axes_of(cycles), strict=True):
        if is_from_rest(cycle):
            judge.rest(cycle.deadline_ns)
        elif cycle.deadline_ns - before.deadline_ns > 1.5e9 * period:
            judge.begin_in_motion()  # where a deadline was skipped, no difference is known
        else:
            # What is sent beside the orientation is its derivative, across the seam as well.
            change = math.dist(cycle.omega_body, before.omega_body) / period
            assert change <= acceleration * 1.01
        assert math.hypot(*cycle.alpha_body) <= acceleration * 1.01
        judge.take(cycle.deadline_ns, cycle.q, joints=tuple(axes))
        before = cycle
    assert not violations, violations[:5]


def assert_never_at_rest(cycles, first, second):
    """Check that motion *second* took over from *first* at full speed.

    Only after the servo process did not run for a while does the speed rise from rest.
    """
    moving = [cycle for cycle in cycles if cycle.motion in (first, second)]
    at = next(k for k, cycle in enumerate(moving) if cycle.motion == second)
    assert moving[0].speed == 1.0
    for before, cycle in itertools.pairwise(moving[: at + 5]):
        assert cycle.speed >= before.speed or is_from_rest(cycle)
    around = moving[at - 5 : at + 5]
    assert {cycle.state for cycle in around} == {ServoState.STREAMING}
    for cycle in around:
        assert np.linalg.norm(cycle.omega_body) >= 0.1 * cycle.speed


def numbers(cycles):
    return sorted({cycle.motion for cycle in cycles} - {0})


def test_gimbal_is_given_a_new_target_on_its_way(gimbal):
    first = gimbal.robot.move(round_and_round(), approach=True)
    until(lambda: gimbal.report.path_time > 0.5, "a motion under way")
    second = gimbal.robot.move([key(0.4, 0.5, 0.6)], approach=True)
    assert second.wait(30.0).outcome == pb.OUTCOME_DONE
    assert first.wait(5.0).outcome == pb.OUTCOME_REPLACED
    cycles = gimbal.log.cycles()
    assert_never_at_rest(cycles, *numbers(cycles))
    assert_smooth(cycles)
    assert rotation.angle(np.array(cycles[-1].q), rotation.exp([0.4, 0.5, 0.6])) < 1e-6


def test_gimbal_keeps_moving_where_a_new_target_is_refused(gimbal):
    first = gimbal.robot.move([key(0, 0, 0), key(0, 0, 1.5)], approach=True)
    until(lambda: gimbal.report.path_time > 0.3, "a motion under way")
    with pytest.raises(LimitError, match="angular acceleration"):
        gimbal.robot.move([{"rotation_vector": [0, 0, 0], "time": 0},
                           {"rotation_vector": [0, 0, 3], "time": 0.5}], approach=True)  # fmt: skip
    assert first.wait(30.0).outcome == pb.OUTCOME_DONE
    assert gimbal.report.fault_text == ""


def test_gimbal_is_given_a_new_target_in_the_midst_of_a_passage_by_the_pole(gimbal):
    first = gimbal.robot.move(over_the_top(), approach=True)
    until(lambda: gimbal.pitch() < -79, "the pole")
    # Straight on and a little aside.
    second = gimbal.robot.move([key(0.1, -2.2, 0)], approach=True)
    assert second.wait(30.0).outcome == pb.OUTCOME_DONE
    assert first.wait(5.0).outcome == pb.OUTCOME_REPLACED
    cycles = gimbal.log.cycles()
    assert_smooth(cycles)
    assert_never_at_rest(cycles, *numbers(cycles))
    at = next(k for k, cycle in enumerate(cycles) if cycle.motion == numbers(cycles)[1])
    assert abs(np.rad2deg(axes_of(cycles)[at, 1]) + 90) < 12
    assert rotation.angle(np.array(cycles[-1].q), rotation.exp([0.1, -2.2, 0])) < 1e-6


@pytest.mark.slow
@pytest.mark.parametrize("gimbal", [(*SLEWS, *QUICK)], indirect=True)
def test_gimbal_stops_and_slews_where_an_axis_has_no_way_on(gimbal):
    """Yaw to 120 degrees where it may turn to 100: over the top it may."""
    plan = gimbal.robot.plan([key(0, 0, np.deg2rad(a)) for a in (0, 40, 80, 120)], approach=True)
    (note,) = [note for note in plan.certificate.notes if "stops and the axes slew" in note]
    assert "to -" in note
    move = gimbal.robot.move(plan)
    assert move.wait(60.0).outcome == pb.OUTCOME_DONE
    cycles = gimbal.log.cycles()
    assert_smooth(cycles, velocity=3.5, acceleration=30.0)
    axes = np.rad2deg(axes_of(cycles))
    assert np.max(np.abs(axes[:, 0])) <= 100.5
    assert rotation.angle(np.array(cycles[-1].q), rotation.exp([0, 0, np.deg2rad(120)])) < 1e-6
    assert abs(gimbal.bus.state(1)["goal"] - (2048 + axes[-1, 0] * 4096 / 360)) <= 1


@pytest.mark.parametrize("gimbal", [QUICK], indirect=True)
def test_kept_plan_is_refused_where_the_gimbal_is_on_another_turn_by_now(gimbal):
    def turn(*degrees):
        vectors = [key(0, 0, np.deg2rad(a)) for a in degrees]
        assert gimbal.robot.move(vectors, approach=True).wait(30.0).outcome == pb.OUTCOME_DONE

    turn(0, -85, -170)
    kept = gimbal.robot.plan([key(0, 0, np.deg2rad(a)) for a in (-170, -120)], approach=True)
    turn(-170, -60, 60, 170, 190)
    # The same orientation, a turn of yaw away.
    with pytest.raises(StartError, match="other axis angles"):
        gimbal.robot.move(kept)
    assert gimbal.report.state == pb.STATE_HOLDING
    assert np.rad2deg(axes_of(gimbal.log.cycles())[-1, 0]) == pytest.approx(190, abs=0.1)
    turn(190, 60, -60, -170)
    assert gimbal.robot.move(kept).wait(30.0).outcome == pb.OUTCOME_DONE


def test_gimbal_follows_targets_and_says_how_far_it_is_from_them(gimbal):
    began = time.monotonic()
    with gimbal.robot.track() as tracking:

        def aim(yaw, rate):
            tracking.aim(key(0, 0, yaw), angular_velocity=[0.0, 0.0, rate], time_to_live=0.2)
            time.sleep(1 / 60)
            return tracking.report.error

        while (elapsed := time.monotonic() - began) < 2.0:
            aim(0.5 * elapsed, 0.5)
        until(lambda: aim(1.0, 0.0) < 0.1, "the last target")
    until(lambda: gimbal.report.state == pb.STATE_HOLDING, "rest")
    assert gimbal.report.fault_text == ""
    cycles = gimbal.log.cycles()
    assert_smooth(cycles)
    assert 0.9 < axes_of(cycles)[-1, 0] < 1.1
    move = gimbal.robot.move([key(0, 0, 0)], approach=True)
    assert move.wait(30.0).outcome == pb.OUTCOME_DONE
