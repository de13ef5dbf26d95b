"""The Python client and the control socket, against a daemon in a process of its own."""

import os
import pwd
import signal
import subprocess
import sys
import threading
import time

import grpc
import numpy as np
import pytest
from google.rpc import error_details_pb2, status_pb2
from harness import DEVICE, DaemonProcess, channel_to, nudge, resident_kib, spin, until
from scipy.spatial.transform import Rotation

import orientd
from orientd import rotation
from orientd.errors import (
    DaemonError,
    LeaseError,
    LimitError,
    RequestError,
    StartError,
    StateError,
    UnknownNameError,
)
from orientd.files import MOST_BYTES
from orientd.protocol import control_pb2 as pb
from orientd.protocol import to_quaternion
from orientd.protocol.reports import samples
from orientd.protocol.stub import control_stub
from orientd.rotation import Quaternion

pytestmark = pytest.mark.world

LEASE_SECONDS = 3.0


@pytest.fixture(scope="module")
def daemon(tmp_path_factory):
    process = DaemonProcess(tmp_path_factory.mktemp("daemon"), lease=LEASE_SECONDS)
    process.start()
    process.stub.ReleaseLease(pb.ReleaseLeaseRequest(token=process.token))
    yield process
    assert process.end() == 0
    assert "Traceback" not in (process.folder / "log").read_text()


@pytest.fixture
def robot(daemon):
    """A client, with the device brought back to where it began."""
    with orientd.connect(daemon.socket, holder="ana") as client:
        yield client
        client.stop()
        until(lambda: state(client) == pb.STATE_HOLDING, "rest")


def state(robot):
    return robot.state().devices[DEVICE].state


def here(robot):
    """Return where the device is commanded to be, as a keyframe."""
    w, x, y, z = to_quaternion(robot.state().devices[DEVICE].cycle.q)
    return Quaternion(w=w, x=x, y=y, z=z)


def long_motion(robot, seconds=20.0):
    """Begin a motion that lasts, and return its handle once it moves."""
    handle = robot.move(
        Rotation.from_rotvec([[0, 0, 0], [0, 0, 1.5], [0.4, 0, 0]]),
        times=[0.0, seconds / 2, seconds],
        approach=True,
    )
    until(lambda: handle.progress is not None and handle.progress.path_time > 0.3, "motion")
    return handle


def test_a_plan_can_be_looked_at_and_then_run(robot):
    plan = robot.plan([here(robot), {"rotation_vector": [0.0, 0.0, 0.2]}], sample_rate_hz=100.0)
    assert samples(plan).times[-1] == pytest.approx(plan.duration, abs=1e-9)
    assert plan.certificate.peak_velocity.value <= plan.certificate.peak_velocity.limit
    handle = robot.move(plan)
    assert handle.plan.motion_id == plan.motion_id
    assert handle.wait().outcome == pb.OUTCOME_DONE
    end = to_quaternion(robot.state().devices[DEVICE].cycle.q)
    assert rotation.angle(end, samples(plan).q[-1]) < 1e-9


def test_every_cycle_can_be_watched(robot):
    watch = robot.watch(rate_hz=50.0)
    cycles = [cycle for _, batch in zip(range(20), watch, strict=False) for cycle in batch]
    watch.close()
    indices = [cycle.index for cycle in cycles]
    assert indices == list(range(indices[0], indices[0] + len(indices)))


def test_some_cycles_can_be_watched(robot):
    watch = robot.watch(rate_hz=50.0, decimation=10)
    cycles = [cycle for _, batch in zip(range(10), watch, strict=False) for cycle in batch]
    watch.close()
    assert cycles
    assert {cycle.index % 10 for cycle in cycles} == {0}


def test_a_motion_can_be_paused_and_resumed_and_slowed(robot):
    handle = long_motion(robot, seconds=3.0)
    assert robot.pause().is_paused
    until(lambda: robot.state().devices[DEVICE].cycle.speed == 0.0, "rest on the path")
    assert not handle.is_done
    assert not robot.resume().is_paused
    assert handle.speed == 1.0
    assert robot.set_speed(0.5).speed == 0.5
    until(lambda: handle.is_done or handle.progress.speed == 0.5, "half the speed")
    assert robot.set_speed(1.0).speed == 1.0
    assert handle.wait(30.0).outcome == pb.OUTCOME_DONE


def me():
    """Return who this is, as the daemon knows it; not as the client calls itself."""
    return f"{pwd.getpwuid(os.getuid()).pw_name} (user:{os.getuid()})"


def test_anybody_may_stop_and_is_named(daemon, robot):
    handle = long_motion(robot)
    with orientd.connect(daemon.socket, holder="ben") as other:
        other.stop()
    assert handle.wait(10.0, check=False).text == f"stopped by {me()}"


def is_moving(device):
    return device.state == pb.STATE_STREAMING and device.path_time > 0.3


def rest(daemon):
    device = daemon.device()
    return device if device.state == pb.STATE_HOLDING else None


@pytest.mark.real
def test_a_client_that_is_killed_stops_its_motion(daemon):
    code = (
        "import sys, time, orientd\n"
        "from orientd import Quaternion as Q\n"
        "robot = orientd.connect(sys.argv[1])\n"
        "turn = {'rotation_vector': [0, 0, 1.5]}\n"
        "back = {'rotation_vector': [0, 0.5, 0]}\n"
        "handle = robot.move([turn, back], times=[0, 20], approach=True)\n"
        "print('moving', flush=True)\n"
        "time.sleep(60)\n"
    )
    process = subprocess.Popen(
        [sys.executable, "-c", code, str(daemon.socket)], stdout=subprocess.PIPE, text=True
    )
    assert process.stdout.readline() == "moving\n"
    until(lambda: is_moving(daemon.device()), "motion")
    process.send_signal(signal.SIGKILL)
    process.communicate()
    device = until(lambda: rest(daemon), "rest")
    assert device.path_time < device.duration
    until(lambda: not daemon_lease(daemon), "the lease's end")


def daemon_lease(daemon):
    return daemon.stub.GetState(pb.GetStateRequest()).daemon.leases


def test_a_taken_lease_is_refused_but_not_a_look(daemon, robot):
    robot.acquire_lease()
    with orientd.connect(daemon.socket, holder="ben") as other:
        assert other.state().daemon.leases[0].holder == "ana"
        with pytest.raises(
            LeaseError, match=r"held by 'ana' \(user:\d+\), for another [0-3]\.\d s"
        ):
            other.enable()
        robot.release_lease()
        assert other.enable().state == pb.STATE_HOLDING


def test_a_held_lease_is_renewed_for_as_long_as_it_is_needed(robot):
    robot.acquire_lease()
    token = robot.lease_token
    handle = long_motion(robot, seconds=2.5 * LEASE_SECONDS)
    assert handle.wait(30.0).outcome == pb.OUTCOME_DONE
    assert robot.lease_token == token


def test_a_lease_that_is_not_renewed_stops_its_motion(daemon):
    answer = daemon.stub.AcquireLease(pb.AcquireLeaseRequest(holder="ana"))
    daemon.token = answer.lease.token
    *_, last = daemon.move(spin(10.0))
    assert last.summary.outcome == pb.OUTCOME_STOPPED
    assert last.summary.text == f"the lease of {me()} has expired"
    request = pb.CommandRequest(lease_token=answer.lease.token)
    with pytest.raises(grpc.RpcError) as caught:
        daemon.stub.Enable(request)
    assert caught.value.code() is grpc.StatusCode.FAILED_PRECONDITION
    assert "has expired or was released" in caught.value.details()


def test_a_program_commands_beside_another_of_the_same_user_on_purpose(daemon, robot):
    robot.acquire_lease()
    with orientd.connect(daemon.socket, holder="ben") as other:
        with pytest.raises(LeaseError, match="held by"):
            other.enable()
        other.acquire_lease(beside=True)
        other.enable()
    with orientd.connect(daemon.socket, holder="eve", beside=True) as other:
        other.enable()
    with (
        pytest.warns(DeprecationWarning, match="is beside= now"),
        orientd.connect(daemon.socket, holder="old", lease=robot.lease_token) as other,
    ):
        other.enable()
    assert robot.enable().state == pb.STATE_HOLDING


def test_errors_arrive_as_what_they_are(robot):
    with pytest.raises(UnknownNameError, match=r"^device: expected one of arm, got 'leg'"):
        robot.enable("leg")
    with pytest.raises(RequestError, match=r"^speed: expected more than 0"):
        robot.set_speed(1.5)
    with pytest.raises(StateError, match="no motion to pause"):
        robot.pause()
    with pytest.raises(LimitError) as caught:
        robot.move([here(robot), {"rotation_vector": [0, 0, 3]}], times=[0, 0.1], approach=True)
    assert caught.value.limit > 0.0
    with pytest.raises(StartError):
        robot.move([{"rotation_vector": [0, 0, 3]}, {"rotation_vector": [0, 0, 2]}], times=[0, 9])
    with pytest.raises(RequestError, match=r"^progress_rate_hz: expected 0.1 to 100"):
        robot.move([here(robot), here(robot)], progress_rate_hz=1e6)
    with pytest.raises(RequestError, match=r"^rate_hz: expected 0.1 to 100"):
        next(robot.watch(rate_hz=1e6))
    with pytest.raises(RequestError, match=r"^sample_rate_hz: expected 0 to 500"):
        robot.plan([here(robot), {"rotation_vector": [0, 0, 0.1]}], sample_rate_hz=1e6)


def test_a_second_motion_must_begin_where_the_first_one_is_by_then(robot):
    handle = long_motion(robot)
    with pytest.raises(StartError, match="set `approach: true` to plan a lead-in"):
        robot.move([{"rotation_vector": [0, 1.0, 0]}, {"rotation_vector": [0, 0, 0.1]}])
    assert not handle.is_done


def test_a_disabled_device_does_not_move(robot):
    robot.disable()
    try:
        with pytest.raises(StateError, match="idle, not holding; enable it first"):
            robot.move([here(robot), {"rotation_vector": [0, 0, 0.1]}])
    finally:
        robot.enable()


def test_a_call_for_anything_else_is_refused(daemon):
    with pytest.raises(grpc.RpcError) as caught:
        daemon.stub.Move(pb.MoveRequest(lease_token="", device=DEVICE)).next()
    assert caught.value.code() is grpc.StatusCode.FAILED_PRECONDITION
    token = daemon.stub.AcquireLease(pb.AcquireLeaseRequest(holder="ana")).lease.token
    try:
        with pytest.raises(grpc.RpcError) as caught:
            daemon.stub.Move(pb.MoveRequest(lease_token=token)).next()
        details = dict(caught.value.trailing_metadata())["grpc-status-details-bin"]
        status = status_pb2.Status.FromString(details)
        bad_request = error_details_pb2.BadRequest()
        assert status.details[0].Unpack(bad_request)
        assert bad_request.field_violations[0].field == "motion"
    finally:
        daemon.stub.ReleaseLease(pb.ReleaseLeaseRequest(token=token))


@pytest.mark.real
def test_two_hundred_thousand_keyframes_fit_into_a_message(daemon):
    count = 200_000
    columns = pb.KeyframeColumns(quaternions=[1.0, 0.0, 0.0, 0.0] * count, times=range(count))
    columns.quaternions[0] = 1.1
    with pytest.raises(grpc.RpcError) as caught:
        # Longer than a plan may take by itself: reading them takes a busy machine its time.
        daemon.stub.Plan(
            pb.PlanRequest(motion=b"{}", columns=columns.SerializeToString()), timeout=60.0
        )
    assert caught.value.code() is grpc.StatusCode.INVALID_ARGUMENT
    assert caught.value.details().startswith("keyframes[0].quaternion: norm must be 1")


@pytest.mark.real
def test_the_largest_motion_file_fits_into_a_message(daemon, tmp_path):
    path, text = tmp_path / "motion.yaml", nudge(0.1)
    path.write_bytes(text + b"\n#".ljust(MOST_BYTES - len(text), b"x"))
    with orientd.connect(daemon.socket) as robot:
        assert robot.plan(path).duration > 0.0


def test_a_client_of_an_earlier_version_is_refused_with_both_versions(daemon):
    """Its motion, a message, has field number 2 in a PlanRequest and 3 in a MoveRequest."""
    plan, move = (pb.PlanRequest.FromString(b"\x12\x01x"), pb.MoveRequest.FromString(b"\x1a\x01x"))
    move.holder = "ana"
    for call in (lambda: daemon.stub.Plan(plan), lambda: next(daemon.stub.Move(move))):
        with pytest.raises(grpc.RpcError) as caught:
            call()
        versions = (
            f"0.2 or earlier, and its motions cannot be read by orientd {orientd.__version__}"
        )
        assert versions in caught.value.details()


@pytest.mark.parametrize(
    "earlier",
    [
        RequestError("keyframes", "expected at least 1, got 0; add one"),
        RequestError("motion", "expected a motion or a motion_id, got neither"),
        LeaseError("a command needs the lease: acquire it and send its token"),
    ],
    ids=["no keyframes", "no motion", "no lease"],
)
def test_a_daemon_of_an_earlier_version_is_named_with_both_versions(daemon, monkeypatch, earlier):
    """It does not see the motion and who takes the lease, since it knows no such fields."""
    one = [{"rotation_vector": [0, 0, 1]}]
    with orientd.connect(daemon.socket) as robot:
        call = robot._connection.call

        def answer(method, request, **options):
            if isinstance(request, pb.GetStateRequest):
                return call(method, request, **options)
            raise earlier

        monkeypatch.setattr(robot._connection, "call", answer)
        for ask in (robot.plan, robot.move):
            with pytest.raises(type(earlier), match=str(earlier)):
                ask(one)  # of the same version: it says what it says
            with monkeypatch.context() as patched:
                patched.setattr("importlib.metadata.version", lambda _: "9.9.9")
                versions = (
                    f"is of orientd {orientd.__version__}, .* of this client, of orientd 9.9.9"
                )
                with pytest.raises(DaemonError, match=versions):
                    ask(one)


@pytest.mark.real
def test_more_than_a_message_holds_is_refused_in_one_line(daemon):
    request = pb.PlanRequest(motion=b"x" * (65 * 1024 * 1024))
    with orientd.connect(daemon.socket) as robot, pytest.raises(RequestError, match="too large"):
        robot._connection.call(robot._stub.Plan, request)


def test_looks_are_answered_while_a_motion_is_planned(daemon, robot):
    """Planning holds up neither looks nor the renewal of the lease."""
    rng = np.random.default_rng(1)
    turns = np.cumsum(rng.normal(0.0, 0.05, (3000, 3)), axis=0)
    failures = []

    def plan():
        try:
            robot.plan(Rotation.from_rotvec(turns), approach=True)
        except DaemonError as error:
            failures.append(error)

    planning = threading.Thread(target=plan)
    planning.start()
    answers = 0
    with orientd.connect(daemon.socket, holder="ben", timeout=5.0) as other:
        while planning.is_alive() and answers < 20:
            other.state()
            answers += 1
    planning.join()
    assert failures == []
    assert answers


def test_a_daemon_that_goes_away_is_said_clearly(tmp_path):
    with DaemonProcess(tmp_path / "daemon") as process:
        process.stub.ReleaseLease(pb.ReleaseLeaseRequest(token=process.token))
        with orientd.connect(process.socket) as robot:
            handle = long_motion(robot)
            process.process.kill()
            with pytest.raises(DaemonError, match="lost the daemon during motion 1; the device "):
                handle.wait(20.0)
            with pytest.raises((DaemonError, LeaseError)):
                robot.enable()
            with pytest.raises(DaemonError, match="no daemon answers"):
                next(robot.watch())
        process.end()


def test_whoever_watches_can_see_the_plan_that_runs(robot):
    handle = long_motion(robot)
    plan = robot.planned(sample_rate_hz=50.0)
    assert plan.motion_id == handle.plan.motion_id == robot.state().devices[DEVICE].motion_id
    assert plan.certificate == handle.plan.certificate
    assert samples(plan).times[-1] == pytest.approx(plan.duration, abs=1e-9)
    assert not robot.planned(plan.motion_id).HasField("samples")


def test_a_plan_that_is_kept_can_be_seen_by_its_name(robot):
    plan = robot.plan([here(robot), {"rotation_vector": [0.1, 0.0, 0.2]}])
    plan.ClearField("planning")
    assert robot.planned(plan.motion_id) == plan
    with pytest.raises(UnknownNameError, match="has no plan 'nowhere'"):
        robot.planned("nowhere")


def test_a_device_without_axes_has_no_outline(robot):
    observer = robot.observe()
    cycles, outline = next(observer.sight(rate_hz=50.0))
    observer.close()
    assert cycles
    assert outline == ()


@pytest.mark.real
def test_refused_plans_leave_no_memory(tmp_path):
    with DaemonProcess(tmp_path) as daemon, channel_to(daemon.socket) as channel:
        motion = spin(8000.0)
        for _ in range(5):
            asked = [
                control_stub(channel).Plan.future(pb.PlanRequest(motion=motion)) for _ in range(80)
            ]
            time.sleep(0.5)
            for one in asked:
                one.cancel()
            until(lambda asked=asked: all(one.done() for one in asked), "the end of the calls")
        assert len(motion) > 500_000
        assert resident_kib(daemon.process.pid, "VmHWM") < 256 * 1024


@pytest.mark.real
def test_a_refused_track_leaves_no_thread(robot):
    robot.acquire_lease()
    before = threading.active_count()
    for _ in range(5):
        with pytest.raises(RequestError):
            robot.track(limits={"velocity": 1000.0})
    until(lambda: threading.active_count() <= before, "the end of the threads")
