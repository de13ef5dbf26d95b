"""The emulated controller driven by the unmodified client libraries, on real sockets."""

import itertools
import math
import socket
import struct
import time
from contextlib import closing, contextmanager

import pytest
from arm_recording import read_arm, read_setpoints

from emulated_ur import EmulatedRobot, LaunchError

dashboard_client = pytest.importorskip("dashboard_client")
rtde_control = pytest.importorskip("rtde_control")
rtde_io = pytest.importorskip("rtde_io")
rtde_receive = pytest.importorskip("rtde_receive")


@contextmanager
def connected(client):
    """Disconnect while the controller is still there: these clients abort the process otherwise."""
    try:
        yield client
    finally:
        client.disconnect()


def control_of(host):
    return connected(rtde_control.RTDEControlInterface(host))


def receive_of(host, **settings):
    return connected(rtde_receive.RTDEReceiveInterface(host, **settings))


def until(claim, timeout=5.0):
    """Poll *claim* until it holds; the client libraries offer nothing to wait on."""
    ends = time.monotonic() + timeout
    while not claim():
        assert time.monotonic() < ends, "still not so"


def stream(control, pose_at, count, period=0.002):
    """Call servoL at absolute deadlines and return the poses sent."""
    sent, start = [], time.monotonic()
    for k in range(count):
        pose = pose_at(k * period)
        assert control.servoL(pose, 0.0, 0.0, period, 0.1, 300.0)
        sent.append(tuple(pose))
        time.sleep(max(0.0, start + (k + 1) * period - time.monotonic()))
    return sent


def swaying(pose):
    """Return a pose function that rocks the tool about its own axes from rest."""

    def pose_at(t):
        lift = 0.5 - 0.5 * math.cos(1.7 * t)
        return [
            pose[0], pose[1], pose[2] - 0.03 * lift,
            pose[3] + 0.2 * lift, pose[4] - 0.15 * lift, pose[5] + 0.1 * math.sin(t) ** 2,
        ]  # fmt: skip

    return pose_at


def test_tool_offset_and_payload_reach_the_robot(ur_robot):
    with control_of(ur_robot.host) as control:
        assert control.setTcp([0.0, 0.0, 0.1, 0.0, 0.0, 0.0])
        assert control.getTCPOffset() == [0.0, 0.0, 0.1, 0.0, 0.0, 0.0]
        assert control.setPayload(1.5, [0.0, 0.0, 0.05])
        state = ur_robot.state()
        assert (state["payload"], state["payload_cog"]) == (1.5, [0.0, 0.0, 0.05])


@pytest.mark.slow
def test_kinematics_answer_through_the_registers(ur_robot):
    with control_of(ur_robot.host) as control, receive_of(ur_robot.host) as receive:
        q = receive.getActualQ()
        pose = control.getForwardKinematics(q, [0.0] * 6)
        assert control.getInverseKinematics(pose) == pytest.approx(q, abs=1e-9)
        assert control.poseTrans(pose, [0.0] * 6) == pytest.approx(pose, abs=1e-12)


@pytest.mark.parametrize(("model", "is_endless"), [("ur3e", True), ("ur5e", False)])
def test_joints_are_safe_within_the_ranges_of_the_model(ur_host, model, is_endless):
    with EmulatedRobot(ur_host, "--model", model), control_of(ur_host) as control:
        assert control.isJointsWithinSafetyLimits([0.0, -1.0, 1.0, 0.0, 0.0, 6.2])
        assert control.isJointsWithinSafetyLimits([0.0, -1.0, 1.0, 0.0, 0.0, 7.0]) is is_endless
        assert not control.isJointsWithinSafetyLimits([7.0, -1.0, 1.0, 0.0, 0.0, 0.0])


@pytest.mark.slow
def test_io_client_moves_the_speed_slider(ur_robot):
    with connected(rtde_io.RTDEIOInterface(ur_robot.host)) as io:
        assert io.setSpeedSlider(0.5)
        with receive_of(ur_robot.host) as receive:
            until(lambda: abs(receive.getSpeedScalingCombined() - 0.5) < 1e-9)


def test_dashboard_client_reads_and_orders(ur_robot):
    client = dashboard_client.DashboardClient(ur_robot.host)
    client.connect()
    with connected(client):
        assert client.isInRemoteControl()
        assert client.polyscopeVersion().startswith("5.12.6")
        assert client.robotmode() == "Robotmode: RUNNING"
        ur_robot.ask("protective_stop")
        assert client.safetystatus() == "Safetystatus: PROTECTIVE_STOP"
        ur_robot.wait_until(lambda _s: _unlocked(client))
        assert client.safetymode() == "Safetymode: NORMAL"


def _unlocked(client):
    try:
        client.unlockProtectiveStop()
    except RuntimeError:
        # Too early; the reply says so.
        return False
    return True


def test_every_servo_pose_arrives_bit_exact(ur_robot, tmp_path):
    with control_of(ur_robot.host) as control, receive_of(ur_robot.host) as receive:
        ur_robot.ask("record on")
        sent = stream(control, swaying(receive.getTargetTCPPose()), 500)
        ur_robot.wait_until(lambda s: s["setpoints"] >= len(sent))
        ur_robot.ask(f"record write {tmp_path / 'run'}")
        assert [row.target for row in read_setpoints(tmp_path / "run")] == sent
        assert control.servoStop()
        moved = [row.actual_pose[2] for row in read_arm(tmp_path / "run")]
        assert max(moved) - min(moved) > 0.005


def test_local_control_refuses_the_control_client(ur_robot):
    ur_robot.ask("local")
    with pytest.raises(RuntimeError, match="remote"):
        rtde_control.RTDEControlInterface(ur_robot.host)


def test_taken_address_is_refused_with_a_reason(ur_robot):
    with pytest.raises(LaunchError, match="in use"):
        EmulatedRobot(ur_robot.host).start()


def test_emulator_ends_cleanly_when_asked(ur_host):
    robot = EmulatedRobot(ur_host)
    robot.start()
    process = robot.process
    robot.end()
    assert process.returncode == 0


class OfficialClient:
    """The packages of UR's own Python client, written by hand from the protocol's description."""

    def __init__(self, host):
        self.sock = socket.create_connection((host, 30004), timeout=5.0)
        self.pending = b""

    def close(self):
        self.sock.close()

    def send(self, kind, payload=b""):
        self.sock.sendall(struct.pack(">HB", 3 + len(payload), ord(kind)) + payload)

    def receive(self, kind):
        while True:
            if len(self.pending) >= 3:
                size, got = struct.unpack_from(">HB", self.pending)
                if len(self.pending) >= size:
                    payload, self.pending = self.pending[3:size], self.pending[size:]
                    if got == ord(kind):
                        return payload
                    continue
            self.pending += self.sock.recv(65536)

    def ask(self, kind, payload=b""):
        self.send(kind, payload)
        return self.receive(kind)


def test_official_clients_packages_are_answered(ur_robot):
    with closing(OfficialClient(ur_robot.host)) as client:
        assert client.ask("V", struct.pack(">H", 2)) == b"\1"
        assert struct.unpack(">4I", client.ask("v"))[0] == 5
        names = b"timestamp,actual_q,output_int_register_20,input_double_register_20"
        assert client.ask("O", struct.pack(">d", 500.0) + names) == (
            b"\1DOUBLE,VECTOR6D,INT32,DOUBLE"
        )
        assert client.ask("I", b"input_double_register_20") == b"\1DOUBLE"
        assert client.ask("S") == b"\1"
        for number in (0.1, math.pi, -1e-300):
            client.send("U", struct.pack(">Bd", 1, number))
            while struct.unpack(">Bd6did", client.receive("U"))[-1] != number:
                pass
        times = [struct.unpack_from(">Bd", client.receive("U"))[1] for _ in range(100)]
        steps = [b - a for a, b in itertools.pairwise(times)]
        assert steps == pytest.approx([0.002] * 99, abs=1e-9)
        assert times[0] > 40.0
        assert client.ask("P") == b"\1"
