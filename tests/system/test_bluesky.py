"""An axis of rotation in bluesky's own RunEngine: moves, scans, stops, fly scans."""

import contextlib
import math
import threading
import time

import numpy as np
import pytest
from gimbal_bench import GimbalDaemon, await_hold
from harness import CycleLog, DaemonProcess, until

from orientd import connect
from orientd.errors import DaemonError, LimitError, PlanError, RequestError, StateError
from orientd.protocol import control_pb2 as pb
from orientd_bluesky import FlyScan, RotationAxis

event_model = pytest.importorskip("event_model")
bluesky = pytest.importorskip("bluesky")

from bluesky import plan_stubs as bps  # noqa: E402 - they may be missing
from bluesky import plans as bp  # noqa: E402
from bluesky import protocols  # noqa: E402
from bluesky.utils import FailedStatus, RunEngineInterrupted  # noqa: E402

pytestmark = pytest.mark.world


@pytest.fixture
def robot(daemon):
    with connect(daemon.socket) as robot:
        yield robot


@pytest.fixture
def theta(robot):
    with RotationAxis(robot, name="theta") as axis:
        axis.set(0.0).exception(30.0)
        yield axis


@pytest.fixture
def engine():
    return bluesky.RunEngine({})


@pytest.fixture
def documents(engine):
    """Return the documents that the engine emits, each checked against its schema."""
    emitted = []

    def take(name, document):
        event_model.schema_validators[event_model.DocumentNames[name]].validate(document)
        emitted.append((name, document))

    engine.subscribe(take)
    return emitted


def events(documents):
    """Return time and angles of every event."""
    found = []
    for name, document in documents:
        if name == "event":
            found.append((document["time"], document["data"]))
        elif name == "event_page":
            rows = [dict(zip(document["data"], row, strict=True))
                    for row in zip(*document["data"].values(), strict=True)]  # fmt: skip
            stamps = document["timestamps"]["theta"]
            found.extend(zip(stamps, rows, strict=True))
    return found


def at_rest(daemon):
    return until(lambda: daemon.device().state == pb.STATE_HOLDING, "the device to hold")


def test_the_axis_supports_the_protocols_of_bluesky(theta):
    for protocol in (
        protocols.Readable, protocols.Configurable, protocols.Movable, protocols.Locatable,
        protocols.Stoppable, protocols.Preparable, protocols.Flyable, protocols.EventCollectable,
        protocols.HasHints, protocols.HasName, protocols.HasParent,
    ):  # fmt: skip
        assert isinstance(theta, protocol), protocol
    assert isinstance(theta.set(0.0), protocols.Status)


def test_mv_turns_the_device_and_counts_whole_turns(theta, engine):
    engine(bps.mv(theta, 30.0))
    assert theta.position == pytest.approx(30.0, abs=1e-6)
    engine(bps.mv(theta, 400.0))
    assert theta.locate() == pytest.approx({"setpoint": 400.0, "readback": 400.0}, abs=1e-6)
    engine(bps.mvr(theta, -380.0))
    assert theta.position == pytest.approx(20.0, abs=1e-6)


def test_a_scan_reads_the_angle_at_every_point(theta, engine, documents):
    engine(bp.scan([theta], theta, -30, 30, 7))
    angles = [data["theta"] for _, data in events(documents)]
    assert angles == pytest.approx(np.linspace(-30, 30, 7), abs=1e-6)
    assert [name for name, _ in documents][:2] == ["start", "descriptor"]
    assert documents[-1][1]["exit_status"] == "success"
    descriptor = documents[1][1]
    assert descriptor["data_keys"]["theta"]["units"] == "deg"
    assert descriptor["configuration"]["theta"]["data"]["theta_velocity"] == pytest.approx(
        math.degrees(2.5)
    )
    assert descriptor["hints"]["theta"] == {"fields": ["theta"]}


def test_a_move_ends_when_its_end_is_measured(tmp_path):
    """The measurements of this device are 0.4 s old."""
    daemon = DaemonProcess(tmp_path / "daemon", options="delay_cycles = 200", patience=None)
    config = daemon.config.read_text()
    daemon.config.write_text(
        config.replace('driver = "loopback"\n', 'driver = "loopback"\nfeedback_timeout = 5.0\n')
    )
    with daemon:
        daemon.stub.ReleaseLease(pb.ReleaseLeaseRequest(token=daemon.token))
        with connect(daemon.socket) as robot, RotationAxis(robot, name="theta") as theta:
            assert theta.set(30.0).exception(30.0) is None
            assert theta.position == pytest.approx(30.0, abs=1e-6)


def test_count_reads_the_axis_without_moving_it(theta, engine, documents, daemon):
    before = daemon.device().motion_number
    engine(bp.count([theta], num=5))
    assert [data["theta"] for _, data in events(documents)] == pytest.approx([0.0] * 5, abs=1e-6)
    assert daemon.device().motion_number == before


def test_a_stopped_move_comes_to_rest_on_its_path_and_fails(theta, engine, daemon):
    theta.velocity_deg = 10.0

    def plan():
        yield from bps.abs_set(theta, 90.0, group="turn")
        until(lambda: theta.position > 1.0, "the device to move")
        yield from bps.stop(theta)
        yield from bps.wait("turn")

    with pytest.raises(FailedStatus) as failed:
        engine(plan())
    assert "was stopped" in str(failed.value.__cause__)
    at_rest(daemon)
    assert 1.0 < theta.position < 80.0


def test_an_aborted_plan_stops_the_device(theta, engine, daemon):
    theta.velocity_deg = 10.0

    def pause():
        until(lambda: theta.position > 1.0, "the device to move")
        engine.request_pause()

    thread = threading.Thread(target=pause)
    thread.start()
    with pytest.raises(RunEngineInterrupted):
        engine(bp.scan([theta], theta, 0, 90, 2))
    thread.join()
    engine.abort("enough")
    at_rest(daemon)
    assert 1.0 < theta.position < 80.0
    daemon.assert_limits_kept()


SCAN = FlyScan(start_deg=-30.0, stop_deg=30.0, points=25, time_per_point=0.05)


def fly(axis, scan):
    yield from bps.prepare(axis, scan, wait=True)
    return (yield from bp.fly([axis]))


@pytest.fixture
def log(daemon):
    with contextlib.closing(CycleLog(daemon.socket)) as log:
        yield log


class Flight:
    """The setpoints of the newest motion; a servo that misses cycles passes the points later.

    Attributes:
        cycles: those in which it moves.
        sent: angles at the trigger times, degrees.
        planned: the same, if the servo had missed no cycle since the start.
        end: the last angle, degrees.
        late: how late the servo started it, s.
    """

    def __init__(self, daemon, log, triggers):
        cycles, period = log.cycles(), daemon.period
        number = max(cycle.motion for cycle in cycles)
        cycles = [cycle for cycle in cycles if cycle.motion == number]
        path = period * np.array([cycle.path_index + cycle.path_fraction for cycle in cycles])
        due = 1e-9 * np.array([cycle.deadline_ns for cycle in cycles]) + period
        begin = np.argmax(path > path[0])  # before, it waits for its start time
        self.late = due[begin] - due[begin - 1] - period
        path, due, self.cycles = path[begin:], due[begin:], cycles[begin:]
        half_turns = [math.atan2(cycle.q[3], cycle.q[0]) for cycle in self.cycles]
        angles = np.degrees(np.unwrap(2.0 * np.array(half_turns)))
        at = np.array(triggers) - (time.time() - time.monotonic())
        self.sent = np.interp(at, due, angles)
        self.planned = np.interp(at, due[0] + path - path[0], angles)
        self.end = angles[-1]


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_fly_scan_passes_every_point_on_time_at_a_constant_rate(
    theta, engine, documents, daemon, log, sign
):
    scan = FlyScan(
        start_deg=sign * SCAN.start_deg,
        stop_deg=sign * SCAN.stop_deg,
        points=SCAN.points,
        time_per_point=SCAN.time_per_point,
    )
    engine(fly(theta, scan))
    found = events(documents)
    triggers = [when for when, _ in found]
    flight = Flight(daemon, log, triggers)
    assert documents[-1][1]["num_events"] == {"primary": scan.points}
    assert np.diff(triggers) == pytest.approx(scan.time_per_point, abs=1e-6)
    # The clocks of the day and of the cycles drift apart by less than a millisecond in a scan.
    drift = 1e-3 * math.degrees(abs(scan.rate))
    assert [data["theta_setpoint"] for _, data in found] == pytest.approx(flight.sent, abs=drift)
    points = np.linspace(scan.start_deg, scan.stop_deg, scan.points)
    tolerance = drift + flight.late * math.degrees(abs(scan.rate))
    assert flight.planned == pytest.approx(points, abs=tolerance)
    # The loopback device is where the setpoint wants it, up to a cycle early.
    lead = [data["theta"] - data["theta_setpoint"] for _, data in found]
    late = daemon.period * (flight.cycles[-1].missed - flight.cycles[0].missed)
    late += 1e-9 * max(cycle.lateness_ns for cycle in flight.cycles)
    assert np.abs(lead).max() < (0.004 + late) * math.degrees(abs(scan.rate))
    # Between the first point and the last, every setpoint has exactly that rate along the path.
    angles = np.array([2.0 * math.atan2(one.q[3], one.q[0]) for one in flight.cycles])
    speeds = np.array([cycle.speed for cycle in flight.cycles])
    inside = (np.abs(angles) < math.radians(30.0)) & (speeds > 0.0)
    assert np.count_nonzero(inside) > 0.9 * scan.duration / daemon.period
    rates = np.array([cycle.omega_body[2] for cycle in flight.cycles])
    assert rates[inside] == pytest.approx(scan.rate * speeds[inside], rel=1e-9)
    daemon.assert_limits_kept()


def test_a_fly_scan_may_go_over_whole_turns(theta, engine, documents, daemon, log):
    scan = FlyScan(start_deg=0.0, stop_deg=540.0, points=10, time_per_point=0.5)
    engine(fly(theta, scan))
    found = events(documents)
    flight = Flight(daemon, log, [when for when, _ in found])
    assert [data["theta_setpoint"] for _, data in found] == pytest.approx(flight.sent, abs=0.2)
    assert flight.planned == pytest.approx(np.linspace(0.0, 540.0, 10), abs=3.0)


def test_a_fly_scan_that_is_stopped_has_the_points_it_has_passed(theta, daemon, log):
    scan = FlyScan(start_deg=0.0, stop_deg=90.0, points=10, time_per_point=1.0)
    assert theta.prepare(scan).exception(30.0) is None
    theta.kickoff()
    until(lambda: theta.position > 25.0, "the device to pass three points")
    theta.stop()
    failure = theta.complete().exception(30.0)
    assert isinstance(failure, StateError)
    found = list(theta.collect())
    flight = Flight(daemon, log, [event["time"] for event in found])
    passed = [event["data"]["theta_setpoint"] for event in found]
    assert passed == pytest.approx(flight.sent, abs=0.02)
    assert len(set(passed)) == len(passed)  # none from after it came to rest
    points = [min(10.0 * k, flight.end) for k in range(len(passed))]
    assert flight.planned == pytest.approx(points, abs=1.0)
    assert 3 <= len(passed) < 10
    at_rest(daemon)


def test_a_stop_that_counts_as_success_ends_without_an_error(theta):
    theta.velocity_deg = 10.0
    status = theta.set(90.0)
    theta.stop(success=True)
    assert status.exception(30.0) is None
    assert status.success


def test_a_new_target_replaces_the_old_one(theta):
    theta.velocity_deg = 20.0
    first = theta.set(90.0)
    second = theta.set(10.0)
    assert "was replaced" in str(first.exception(30.0))
    assert second.exception(30.0) is None
    assert theta.position == pytest.approx(10.0, abs=1e-6)


def test_mistakes_are_one_clear_line(theta, robot, daemon):
    before = daemon.device().motion_number
    for wrong in ("far", math.nan, math.inf, None):
        with pytest.raises(RequestError, match="expected an angle in degrees"):
            theta.set(wrong)
    with pytest.raises(StateError, match="prepare one before kickoff"):
        theta.kickoff()
    with pytest.raises(StateError, match="kickoff starts one"):
        theta.complete()
    with pytest.raises(RequestError, match="expected a FlyScan"):
        theta.prepare(30.0)
    for wrong, field in (
        ({"points": 1}, "points"),
        ({"points": 2.5}, "points"),
        ({"time_per_point": 0.0}, "time_per_point"),
        ({"stop_deg": -30.0}, "stop_deg"),
        ({"start_deg": math.nan}, "start_deg"),
    ):
        given = {"start_deg": -30.0, "stop_deg": 30.0, "points": 3, "time_per_point": 1.0} | wrong
        with pytest.raises(RequestError, match=field):
            FlyScan(**given)
    with pytest.raises(RequestError, match="expected x, y or z"):
        RotationAxis(robot, name="wrong", axis="w")
    with pytest.raises(RequestError, match="expected one of arm"):
        RotationAxis(robot, name="wrong", device="leg")
    assert daemon.device().motion_number == before


def test_a_fly_scan_beyond_the_limits_is_refused_before_the_device_moves(theta, daemon):
    too_fast = FlyScan(start_deg=0.0, stop_deg=90.0, points=10, time_per_point=0.01)
    with pytest.raises(PlanError):
        theta.prepare(too_fast)
    assert daemon.device().state == pb.STATE_HOLDING
    with pytest.raises(StateError, match="prepare one before kickoff"):
        theta.kickoff()


def test_a_fly_scan_needs_full_speed(theta, robot):
    assert theta.prepare(SCAN).exception(30.0) is None
    robot.set_speed(0.5)
    try:
        with pytest.raises(StateError, match=r"the speed of the device is 0\.5"):
            theta.kickoff()
    finally:
        robot.set_speed(1.0)


def test_an_angle_beyond_the_end_of_an_axis_is_refused_before_the_device_moves(bus, tmp_path):
    pytest.importorskip("dynamixel_sdk")
    gimbal = GimbalDaemon(tmp_path, bus.link).start()
    try:
        await_hold(gimbal, "gimbal")
        with connect(gimbal.socket) as robot, RotationAxis(robot, name="yaw") as yaw:
            assert yaw.set(-200.0).exception(60.0) is None
            # The axis ends at -270 degrees.  60 degrees is the same orientation.
            for beyond in (-300.0, 300.0):
                with pytest.raises(LimitError, match="angle of yaw"):
                    yaw.set(beyond)
            assert yaw.locate()["setpoint"] == pytest.approx(-200.0, abs=1e-6)
            assert yaw.set(160.0).exception(60.0) is None
            assert yaw.position == pytest.approx(160.0, abs=0.5)
    finally:
        gimbal.end()


def test_an_axis_moves_again_after_a_restart_of_the_daemon(tmp_path, engine):
    with DaemonProcess(tmp_path / "daemon") as daemon:
        daemon.stub.ReleaseLease(pb.ReleaseLeaseRequest(token=daemon.token))
        with connect(daemon.socket) as robot, RotationAxis(robot, name="theta") as theta:
            engine(bps.mv(theta, 20.0))
            daemon.end()
            with pytest.raises(DaemonError):
                theta.read()
            daemon.start()
            daemon.stub.ReleaseLease(pb.ReleaseLeaseRequest(token=daemon.token))
            until(lambda: is_watched(theta), "the axis to be watched again")
            engine(bps.mv(theta, -15.0))
            assert theta.position == pytest.approx(-15.0, abs=1e-6)


def is_watched(axis):
    try:
        axis.read()
    except DaemonError:
        return False
    return True
