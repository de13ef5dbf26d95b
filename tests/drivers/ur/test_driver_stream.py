"""Setpoints and motion of the emulated robot, compared with the plan."""

import numpy as np
import pytest
from arm_recording import read_arm, read_setpoints
from direct_planners import run
from ur_rig import device_of, is_holding, streaming, swing_motion, until

from orientd import rotation
from orientd.daemon.calls.latency_identification import identify
from orientd.errors import Fault
from orientd.planner.recorded import rows_of
from orientd.protocol import control_pb2 as pb

pytest.importorskip("rtde_control")

pytestmark = pytest.mark.world


def orientations(poses):
    return rotation.exp(np.array([pose[3:] for pose in poses]))


def angle_between(p, q):
    return np.linalg.norm(rotation.log(rotation.multiply(rotation.conjugate(p), q)), axis=-1)


def check_motion(robot, tmp_path, *, seconds, count):
    """Stream a motion; compare what arrived with the plan."""
    with device_of(robot.host) as device:
        motion = swing_motion(device, seconds=seconds, count=count)
        before = robot.state()["setpoints"]
        robot.ask("record on")
        # The motion's first record is where the device holds: one of those must be recorded.
        robot.wait_until(lambda s: s["setpoints"] > before + 5)
        run(device, motion)
        streaming(device)
        until(lambda: is_holding(device), "the end", motion.facts.duration + 10.0)
        # Whatever was on its way then has come before fifty more have.
        held = robot.state()["setpoints"]
        robot.wait_until(lambda s: s["setpoints"] > held + 50)
        robot.ask("record off")
        robot.ask(f"record write {tmp_path / 'run'}")
        assert device.snapshot().fault is Fault.NONE
    arrived = orientations([row.target for row in read_setpoints(tmp_path / "run")])
    planned = rows_of(motion.read(0, motion.facts.record_count))[:, :4]
    # Setpoints of the hold come before the motion and after it.
    some = np.arange(0, len(planned), 50)
    lags = range(len(arrived) - len(planned) + 1)
    lag = min(lags, key=lambda k: angle_between(arrived[k + some], planned[some]).max())
    assert angle_between(arrived[lag : lag + len(planned)], planned).max() < 1e-9
    arm = orientations([row.actual_pose for row in read_arm(tmp_path / "run")])
    assert angle_between(arm[:1], arm).max() == pytest.approx(0.3, abs=0.01)


def test_every_setpoint_of_a_motion_arrives_as_planned(ur_robot, tmp_path):
    check_motion(ur_robot, tmp_path, seconds=1.6, count=1)


@pytest.mark.slow
@pytest.mark.timeout(240)
def test_a_minute_of_setpoints_arrives_as_planned(ur_robot, tmp_path):
    check_motion(ur_robot, tmp_path, seconds=3.0, count=20)


def phases_at(robot, tmp_path, **options):
    """Hold for two seconds; return when in the controller's cycle setpoints came, in ticks."""
    with device_of(robot.host, **options) as device:
        begun = device.snapshot().cycle.index
        until(lambda: device.snapshot().cycle.index > begun + 600, "a second of holding")
        robot.ask("record on")
        until(lambda: device.snapshot().cycle.index > begun + 1100, "another second")
        robot.ask(f"record write {tmp_path / 'run'}")
    ticks = {row.tick: row.time_ns for row in read_arm(tmp_path / "run")}
    rows = [row for row in read_setpoints(tmp_path / "run") if row.tick in ticks]
    assert len(rows) > 400
    return np.array([(row.time_ns - ticks[row.tick]) / 2e6 for row in rows])


@pytest.mark.slow
def test_setpoints_settle_where_the_controllers_cycle_takes_each(ur_robot, tmp_path):
    phases = phases_at(ur_robot, tmp_path)
    # Aimed at a quarter after the data has come; what the way and the servo take comes to that.
    assert 0.2 < np.median(phases) < 0.65


def sweep(device):
    """Turn by 0.8 rad and back, at up to 1 rad/s; return the statistics and the cycles."""
    motion = swing_motion(device, angle=0.8, seconds=3.2)
    certificate = pb.Plan.FromString(motion.plan).certificate
    assert certificate.peak_velocity.value == pytest.approx(1.0, abs=0.15)
    begun = run(device, motion)
    streaming(device)
    until(lambda: is_holding(device), "the end")
    last = device.snapshot().cycle.index
    return begun.statistics, device.cycles(last - motion.facts.record_count)


def check_leading(robot, *, factor):
    with device_of(robot.host, lookahead=0.1) as device:
        behind, cycles = sweep(device)
    found = identify(
        [(c.deadline_ns * 1e-9, c.q) for c in cycles],
        [(c.feedback_time_ns * 1e-9, c.feedback_q) for c in cycles],
    )
    with device_of(robot.host, lookahead=0.1, compensate_latency=found.seconds) as device:
        led, _ = sweep(device)
        until(
            lambda: (
                device.snapshot().path_time
                == pytest.approx(device.snapshot().motion.facts.duration)
            ),
            "the end of the path that is reported",
        )
    print(f"{found}; tracking error {behind.tracking_error:.4f}, led {led.tracking_error:.4f} rad")
    assert led.path_error < 1e-9
    assert behind.tracking_error > factor * led.tracking_error
    return found


def test_leading_by_the_identified_latency_removes_four_fifths_of_the_tracking_error(ur_robot):
    found = check_leading(ur_robot, factor=5.0)
    # The model's lookahead and drive, and the way there and back.
    assert found.seconds == pytest.approx(0.1 + 0.004 + 0.003, abs=0.02)
    assert found.error > 5.0 * found.error_led
