"""The command line, end to end."""

import contextlib
import csv
import ctypes
import json
import os
import pty
import re
import signal
import subprocess
import tempfile
from pathlib import Path

import numpy as np
import pytest
from command_line import COMMAND, assert_refused, begin, environment, inside, orientd
from harness import DEVICE, DaemonProcess, is_alive, until

from orientd import rotation
from orientd.protocol import control_pb2 as pb

pytestmark = pytest.mark.world

MOTION = """
keyframes:
  - {rotation_vector: [0, 0, 0]}
  - {rotation_vector: [0.2, 0, 0.4]}
  - {euler: {axes: xyz, degrees: [10, 5, 40]}}
start_velocity: [0, 0, 0.3]
end_velocity: [0.1, 0, 0]
approach: true
"""
SLOW = """
keyframes:
  - {time: 0, rotation_vector: [0, 0, 0.1]}
  - {time: 20, rotation_vector: [0, 0.4, 1]}
approach: true
"""


@pytest.fixture(scope="module")
def daemon(tmp_path_factory):
    with DaemonProcess(tmp_path_factory.mktemp("daemon"), lease=3.0) as process:
        process.stub.ReleaseLease(pb.ReleaseLeaseRequest(token=process.token))
        yield process


@pytest.fixture
def motion(tmp_path):
    path = tmp_path / "motion.yaml"
    path.write_text(MOTION)
    return path


@pytest.fixture
def slow(tmp_path):
    path = tmp_path / "slow.yaml"
    path.write_text(SLOW)
    return path


@pytest.mark.parametrize(
    ("command", "state"),
    [(("serve", "rotctld", "--port", 0), pb.STATE_HOLDING), (("track",), pb.STATE_TRACKING)],
    ids=["accepts", "reads"],
)
@pytest.mark.real
def test_ctrl_c_ends_a_command_whichever_thread_the_kernel_gives_it_to(daemon, command, state):
    process = begin(*command, "--socket", daemon.socket, stdin=subprocess.PIPE)
    if state == pb.STATE_HOLDING:
        assert process.stdout.readline().startswith("ready at")
    until(lambda: daemon.device().state == state, "the command at work")
    asleep = Path(f"/proc/{process.pid}/stat")
    until(
        lambda: asleep.read_text().rpartition(")")[2].split()[0] == "S", "a main thread that waits"
    )
    threads = [int(one.name) for one in Path(f"/proc/{process.pid}/task").iterdir()]
    other = max(one for one in threads if one != process.pid)
    ctypes.CDLL(None).tgkill(process.pid, other, signal.SIGINT)
    process.communicate(timeout=30.0)
    until(lambda: daemon.device().state == pb.STATE_HOLDING, "rest")


def is_moving(device):
    return device.state == pb.STATE_STREAMING and device.path_time > 0.3


def told(done):
    """Return the one JSON object that a command printed."""
    assert (done.returncode, done.stderr) == (0, ""), done
    (line,) = done.stdout.splitlines()
    return json.loads(line)


def test_status_tells_people_and_programs(daemon):
    done = orientd("status", "--socket", daemon.socket)
    assert (done.returncode, done.stderr) == (0, "")
    assert f"process {daemon.process.pid}" in done.stdout
    assert "lease   free" in done.stdout
    assert "arm  loopback at 500 Hz: holding" in done.stdout
    status = told(orientd("status", "--json", env=environment(ORIENTD_SOCKET=str(daemon.socket))))
    assert status["daemon"]["pid"] == daemon.process.pid
    assert status["devices"][DEVICE]["state"] == "holding"
    assert set(status["devices"][DEVICE]["cycle"]["q"]) == set("wxyz")


def test_status_says_how_the_last_motion_ended_and_who_stopped_it(daemon, motion, slow):
    def last():
        return inside("status", "--socket", daemon.socket).stdout.partition("  motion       ")[2]

    assert inside("move", motion, "--socket", daemon.socket).returncode == 0
    assert re.match(r"\d+.*: done, \d\.\d{3} s, speed 1\n", last())
    process = begin("move", slow, "--socket", daemon.socket)
    until(lambda: is_moving(daemon.device()), "the motion")
    assert re.match(r"\d+.*: \d\.\d{3} of \d+\.\d{3} s, speed 1\n", last())
    assert inside("stop", "--socket", daemon.socket).returncode == 0
    process.communicate(timeout=30.0)
    assert re.match(r"\d+.*: stopped by .*, at \d\.\d{3} of \d+\.\d{3} s, speed 1\n", last())


def test_devices_and_methods_are_listed(daemon):
    devices = told(inside("devices", "--json", "--socket", daemon.socket))["devices"]
    assert [device["name"] for device in devices] == [DEVICE]
    methods = told(inside("methods", "--json"))["methods"]
    assert "c2_cumulative" in [method["name"] for method in methods]
    lines = inside("methods").stdout.splitlines()
    assert len(lines) == len(methods) + 1


def test_a_plan_needs_no_daemon_and_fills_a_table(motion, tmp_path):
    path = tmp_path / "out.csv"
    plan = told(orientd("plan", motion, "-o", path, "--json"))["plan"]
    with path.open() as file:
        rows = list(csv.DictReader(file))
    times = np.array([float(row["time_s"]) for row in rows])
    q = np.array([[float(row[f"q{axis}"]) for axis in "wxyz"] for row in rows])
    assert times[-1] == pytest.approx(plan["duration"])
    np.testing.assert_allclose(np.linalg.norm(q, axis=1), 1.0, atol=1e-15)
    # Backward differences of the table are what the certificate says.
    omega = rotation.log(rotation.multiply(rotation.conjugate(q[:-1]), q[1:])) / 0.002
    largest = np.linalg.norm(omega, axis=1).max()
    peak = plan["certificate"]["peak_velocity"]
    assert largest == pytest.approx(peak["on_records"], rel=1e-9)
    assert largest <= peak["value"]


@pytest.mark.real
def test_a_plan_reads_standard_input():
    process = begin("plan", "-", stdin=subprocess.PIPE)
    output, errors = process.communicate(MOTION, timeout=60.0)
    assert (process.returncode, errors) == (0, "")
    assert "through 3 keyframes" in output


def test_a_plan_is_the_same_in_every_kind_of_file(motion, tmp_path):
    paths = [tmp_path / f"out{ending}" for ending in (".csv", ".npz", ".json")]
    for path in paths:
        assert inside("plan", motion, "-o", path).returncode == 0
    table = np.loadtxt(paths[0], delimiter=",", skiprows=1)
    with np.load(paths[1]) as file:
        archive = dict(file)
    content = json.loads(paths[2].read_text())
    np.testing.assert_array_equal(table, content["rows"])
    assert content["columns"] == paths[0].read_text().splitlines()[0].split(",")
    np.testing.assert_array_equal(table[:, 0], archive["time"])
    np.testing.assert_array_equal(table[:, 1:5], archive["q_wxyz"])
    certificate = json.loads(str(archive["certificate"]))
    assert certificate == content["certificate"]


def test_a_plan_can_be_drawn(motion, tmp_path):
    pytest.importorskip("matplotlib")
    path = tmp_path / "plan.png"
    assert inside("plan", motion, "--plot", path).returncode == 0
    assert path.read_bytes().startswith(b"\x89PNG")
    done = inside("plan", motion, "--plot", tmp_path / "plan.nonsense")
    assert done.returncode == 2
    assert len(done.stderr.splitlines()) == 1


def test_a_plan_goes_by_the_device_of_the_configuration(motion, daemon):
    plan = told(inside("plan", motion, "--config", daemon.config, "--json"))["plan"]
    assert plan["certificate"]["rate_hz"] == pytest.approx(500.0)
    done = inside("plan", motion, "--config", daemon.config, "--device", "leg")
    assert (done.returncode, done.stderr) == (
        1,
        "orientd: device: expected one of arm, got 'leg'\n",
    )


def test_a_move_is_shown_in_plain_lines_where_nobody_looks(daemon, motion):
    done = orientd("move", motion, "--socket", daemon.socket)
    assert (done.returncode, done.stderr) == (0, "")
    first, *lines = done.stdout.splitlines()
    assert re.match(r"motion \d+: 3 keyframes, \d", first)
    progress = [line for line in lines if " rad/s  late " in line]
    assert progress
    for line in progress:
        assert re.match(r"\d+\.\d\d of \d+\.\d\d s  w [+-]", line)
        assert "tracking" in line
    assert "\x1b" not in done.stdout
    assert any(line.strip().startswith("end velocities") for line in lines)


def test_a_move_tells_programs_one_object(daemon, motion):
    move = told(orientd("move", motion, "--socket", daemon.socket, "--json"))
    summary, certificate = move["summary"], move["plan"]["certificate"]
    assert summary["outcome"] == "done"
    statistics = summary["statistics"]
    assert statistics["velocity"] <= certificate["peak_velocity"]["limit"] * 1.001
    assert statistics["start_velocity_error"] < 1e-6
    assert statistics["end_velocity_error"] < 1e-6


@pytest.mark.real
def test_a_move_on_a_terminal_is_a_live_line(daemon, slow):
    """The motion is as long as it takes until the line is there."""
    ours, theirs = pty.openpty()
    process = subprocess.Popen(
        [*COMMAND, "move", str(slow), "--socket", str(daemon.socket)],
        stdout=theirs,
        stderr=subprocess.PIPE,
        env=environment(TERM="xterm", COLUMNS="160"),
    )
    os.close(theirs)
    shown = b""
    while b"rad/s  late" not in shown:
        shown += os.read(ours, 4096)
    assert shown.rpartition(b"\n")[2].startswith(b"\rmotion ")
    process.send_signal(signal.SIGINT)
    with contextlib.suppress(OSError):  # of a terminal whose other end is closed
        while os.read(ours, 4096):
            pass
    os.close(ours)
    errors = process.stderr.read()
    process.stderr.close()
    assert process.wait(20) == 1
    assert b"stopped" in errors or b"interrupted" in errors


def follow(daemon, *lines):
    """Give lines to a command that follows targets; return what came of it."""
    process = begin("track", "--socket", daemon.socket, "--json", stdin=subprocess.PIPE)
    output, errors = process.communicate("".join(f"{line}\n" for line in lines), timeout=30.0)
    return subprocess.CompletedProcess(lines, process.returncode, output, errors)


def test_targets_go_on_after_a_bad_line_which_is_named(daemon):
    good = json.dumps({"rotation_vector": [0, 0, 0.1], "time_to_live": 5.0})
    zero = '{"quaternion": {"w": 0, "x": 0, "y": 0, "z": 0}}'
    done = follow(daemon, good, zero, "null", good[:20], good)
    assert done.returncode == 0
    assert [line[:15] for line in done.stderr.splitlines()] == [
        f"orientd: line {k}" for k in (2, 3, 4)
    ]
    report = json.loads(done.stdout)
    assert (report["targets"], report["refused"]) == (2, 3)


WRONG_LINES = {
    '{"base": [1, 0, 0, 0]}': "q_world_base: expected a scipy Rotation, Quaternion(w=, x=, y=, z=)"
    ", or a mapping with quaternion, rotation_vector, euler, matrix, direction, azimuth_elevation "
    "or look_at, got [1, 0, 0, 0]; name its components: a bare sequence does not say its order",
    '{"point": [1, 2, 3], "rotation_vector": [0, 0, 0]}': "rotation_vector: unknown key; known are "
    "velocity, place, roll, frame, pointing_axis, time_ns, time_to_live",
    '{"point": [0, 0]}': "point: expected three numbers, got [0, 0]; give x, y and z",
    '{"point": [1, 0, 0], "roll": "most"}': "roll: expected degrees, got 'most'; "
    "give a finite number",
    '{"point": [1, 0, 0], "frame": "cam"}': "frame: the device has no frame 'cam'; define it in "
    "`frames` of the device",
    '{"rotation_vector": [0, 0, NaN]}': "expected finite numbers, got NaN; leave out this target",
    '{"direction": [0, 0, 0]}': "target.direction: expected a direction, got none: the vector is "
    "zero; give another",
    '{"rotation_vector": [0, 0, 1], "position": [1, 2, 1e7]}': "target.position: expected a "
    "position within 1000 m, got (1.0, 2.0, 10000000.0); give metres",
    '{"quaternion": {"w": 2, "x": 0, "y": 0, "z": 0}}': "target.quaternion: norm must be 1 within "
    "0.001, got 2; divide it by its norm",
    "0.3": "expected a JSON object, got 0.3; write lines such as "
    '{"rotation_vector": [0, 0, 0.3]}; further ones are only counted',
}


def test_a_wrong_line_is_named_with_value_expectation_and_the_next_step(daemon):
    done = follow(daemon, *WRONG_LINES)
    assert done.stderr.splitlines() == [
        f"orientd: line {k}: {line}" for k, line in enumerate(WRONG_LINES.values(), 1)
    ]


def test_nothing_but_bad_lines_is_a_failure(daemon):
    done = follow(daemon, "null")
    assert (done.returncode, json.loads(done.stdout)["refused"]) == (1, 1)
    assert done.stderr.startswith("orientd: line 1: expected a JSON object")


def test_a_free_lease_is_taken_where_there_is_nothing_to_command_beside(daemon):
    beside = ("--lease", "--socket", daemon.socket)
    assert told(inside("speed", "0.5", *beside, "--json"))["speed"] == 0.5
    assert told(inside("speed", "1", *beside, "--json"))["speed"] == 1.0
    assert not daemon.stub.GetState(pb.GetStateRequest()).daemon.leases


def test_a_second_terminal_commands_what_a_move_runs(daemon, slow):
    process = begin("move", slow, "--socket", daemon.socket, "--json")
    until(lambda: is_moving(daemon.device()), "motion")
    beside = ("--lease", "--socket", daemon.socket)
    try:
        refused = inside("pause", "--socket", daemon.socket)
        assert_refused(refused, "is held by 'orientd move", "with --lease, this commands beside it")
        assert "paused" in inside("pause", "--lease", "--socket", daemon.socket).stdout
        until(lambda: daemon.device().cycle.speed == 0.0, "rest on the path")
        assert told(inside("resume", *beside, "--json"))["is_paused"] is False
        assert told(inside("speed", "0.25", *beside, "--json"))["speed"] == 0.25
        until(lambda: daemon.device().cycle.speed == 0.25, "a quarter of the speed")
        inside("speed", "1", *beside)
        stopped = told(inside("stop", "--socket", daemon.socket, "--json"))
        assert [device["name"] for device in stopped["devices"]] == [DEVICE]
    finally:
        output, errors = process.communicate(timeout=20)
    assert process.returncode == 1
    assert json.loads(output)["summary"]["outcome"] == "stopped"
    message = json.loads(errors)["error"]["message"]
    assert f"(user:{os.getuid()})" in message.partition("stopped by")[2]


def test_a_speed_that_was_left_is_told_wherever_a_motion_starts_and_is_reported(daemon, tmp_path):
    path = tmp_path / "there.yaml"
    path.write_text(
        "approach: true\n"
        "keyframes: [{rotation_vector: [0, 0, 0.2]}, {rotation_vector: [0, 0.3, 0]}]"
    )
    at = ("--socket", daemon.socket)
    inside("speed", "0.5", *at)
    try:
        assert "speed 0.5" in inside("status", *at).stdout
        done = inside("move", path, *at)
        assert "runs at speed 0.5, as it was set before" in done.stdout
        assert "  speed                0.5 when it began" in done.stdout
        assert told(inside("move", path, *at, "--json"))["speed"] == 0.5
    finally:
        inside("speed", "1", *at)
    assert "speed" not in inside("move", path, *at).stdout


def test_a_device_is_disabled_and_enabled(daemon):
    assert told(inside("disable", "--socket", daemon.socket, "--json"))["state"] == "idle"
    assert told(inside("enable", "--socket", daemon.socket, "--json"))["state"] == "holding"
    done = inside("reset", "--socket", daemon.socket)
    assert done.stderr == (
        "orientd: reset is not possible while holding, only while fault or idle\n"
    )


@pytest.fixture
def folder():
    """A folder with a path so short that the demo's socket has room in it, wherever this runs."""
    with tempfile.TemporaryDirectory() as name:
        yield Path(name)


def test_the_demo_moves_and_leaves_nothing_behind(folder):
    path = folder / "demo.png"
    environ = environment(TMPDIR=str(folder))
    demo = told(orientd("demo", "--plot", path, "--json", cwd=folder, env=environ))
    statistics, certificate = demo["summary"]["statistics"], demo["plan"]["certificate"]
    assert demo["summary"]["outcome"] == "done"
    assert certificate["lead_in"] > 0.0
    assert certificate["lead_out"] > 0.0
    for name in ("velocity", "acceleration", "jerk"):
        assert statistics[name] <= certificate[f"peak_{name}"]["limit"] * 1.001
    assert statistics["start_velocity_error"] < 1e-6
    assert statistics["end_velocity_error"] < 1e-6
    assert statistics["path_error"] < 1e-9
    if demo["picture"]:
        assert path.read_bytes().startswith(b"\x89PNG")
        path.unlink()
    assert list(folder.iterdir()) == []


def test_the_demo_tells_its_figures_even_if_the_picture_cannot_be_written(folder):
    (folder / "demo.png").mkdir()
    environ = environment(TMPDIR=str(folder))
    done = orientd("demo", "--plot", folder / "demo.png", cwd=folder, env=environ)
    assert_refused(done, "cannot write")
    assert "velocity sent" in done.stdout


def test_the_demo_of_a_policy_names_its_example():
    assert_refused(inside("demo", "policy"), "python examples/policy_chunks/play.py")


def test_a_demo_that_is_interrupted_leaves_no_process(folder):
    process = subprocess.Popen(
        [*COMMAND, "demo"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        cwd=folder,
        env=environment(TMPDIR=str(folder)),
    )
    line = process.stdout.readline()
    servo = int(re.search(r"servo process (\d+)", line)[1])
    # The second line says what will be moved; the third is the first of the motion.
    process.stdout.readline()
    process.stdout.readline()
    process.send_signal(2)
    _, errors = process.communicate(timeout=30)
    assert process.returncode == 1
    (complaint,) = errors.splitlines()
    assert complaint.startswith("orientd: motion 1 stopped")
    assert until(lambda: not is_alive(servo), "the servo's end")


def test_a_demo_that_is_killed_leaves_no_process(folder):
    process = subprocess.Popen(
        [*COMMAND, "demo"],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
        cwd=folder,
        env=environment(TMPDIR=str(folder)),
    )
    servo = int(re.search(r"servo process (\d+)", process.stdout.readline())[1])
    process.kill()
    process.communicate()
    assert until(lambda: not is_alive(servo), "the servo's end")


@pytest.mark.real
def test_the_doctor_measures_and_says_how_to_mend():
    done = orientd("doctor", "--json")
    found = json.loads(done.stdout)
    assert done.returncode == (1 if found["counts"]["problem"] else 0)
    names = [finding["name"] for finding in found["findings"]]
    for name in ("scheduling", "memory lock", "lateness", "kernel", "cores", "shared memory"):
        assert name in names
    for finding in found["findings"]:
        assert finding["verdict"] in ("ok", "improve", "problem")
        assert bool(finding["mend"]) == (finding["verdict"] != "ok")
    assert sum(found["counts"].values()) == len(names)


@pytest.mark.real
def test_the_doctor_that_finds_a_problem_ends_with_1(tmp_path):
    pytest.importorskip("rtde_control")
    text = '[devices.arm]\ndriver = "ur"\n[devices.arm.options]\nhost = "127.0.0.253"\n'
    (tmp_path / "absent.toml").write_text(text)
    done = orientd("doctor", "--json", "--config", tmp_path / "absent.toml")
    assert json.loads(done.stdout)["counts"]["problem"] > 0, done
    assert done.returncode == 1


def test_the_version_is_told():
    import orientd as package

    assert orientd("--version").stdout == f"orientd {package.__version__}\n"
