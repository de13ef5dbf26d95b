"""Bad input, each with one clear line: the field's path, what was expected and what came.

The same motions go in as files through the command line, offline and to a daemon, and as messages
through the socket, and the same field is named.
"""

import json
import os
import re
import signal
import subprocess
import sys

import pytest
from command_line import assert_refused, begin, environment, inside, orientd
from harness import is_alive, until

import orientd as package
from orientd.errors import OrientdError, RequestError
from orientd.protocol import control_pb2 as pb

pytestmark = pytest.mark.world

UPRIGHT = {"quaternion": {"w": 1, "x": 0, "y": 0, "z": 0}}
TURNED = {"rotation_vector": [0, 0, 0.5]}


def motion(*keyframes, **more):
    return {"keyframes": list(keyframes), **more}


# What is wrong, the motion, what the line begins with, what else it says.
BAD_MOTIONS = {
    "unknown key": (
        motion(UPRIGHT, TURNED, velocity_frmae="body"),
        "velocity_frmae: unknown key; did you mean 'velocity_frame'?",
    ),
    "unknown key in a keyframe": (
        motion(UPRIGHT, {"rotation_vektor": [0, 0, 1]}),
        "keyframes[1].rotation_vektor: unknown key",
    ),
    "wrong type": (
        motion(UPRIGHT, {**TURNED, "time": "soon"}),
        "keyframes[1].time: expected a number, got the text 'soon'",
    ),
    "not a number": (
        motion(UPRIGHT, {"rotation_vector": [0, 0, float("nan")]}),
        "keyframes[1].rotation_vector[2]: expected a finite number, got nan",
    ),
    "norm": (
        motion(UPRIGHT, {"quaternion": {"w": 1.1, "x": 0, "y": 0, "z": 0}}),
        "keyframes[1].quaternion: norm must be 1 within 0.001, got 1.1",
    ),
    "two forms": (
        motion(UPRIGHT, {**UPRIGHT, **TURNED}),
        "keyframes[1]: expected one of quaternion, rotation_vector, euler, matrix, "
        "direction, azimuth_elevation, look_at; got quaternion and rotation_vector",
    ),
    "times not increasing": (
        motion({**UPRIGHT, "time": 1.0}, {**TURNED, "time": 0.5}),
        "keyframes[1].time: must be later than keyframes[0] at 1 s, got 0.5 s",
    ),
    "zero-length interval": (
        motion({**UPRIGHT, "time": 1.0}, {**TURNED, "time": 1.0}),
        "keyframes[1].time: 1 s is the time of keyframes[0] too: an interval of length zero",
    ),
    "no keyframe": (motion(), "keyframes: expected at least 1, got 0"),
    "one keyframe with a time": (
        motion({**UPRIGHT, "time": 1.0}),
        "keyframes[0].time: a single keyframe is reached as quickly as the limits permit",
    ),
    "unknown method": (
        motion(UPRIGHT, TURNED, method="c2_cumulativ"),
        "method: unknown method 'c2_cumulativ'; did you mean 'c2_cumulative'?",
    ),
    "limit broken": (
        motion({**UPRIGHT, "time": 0.0}, {"rotation_vector": [0, 0, 3], "time": 0.2}),
        "angular acceleration reaches",
    ),
    "limit above the device's": (
        motion(UPRIGHT, TURNED, limits={"velocity": 99.0}),
        "limits.velocity: must be at most the device's 2.5 rad/s, got 99",
    ),
}
each = pytest.mark.parametrize(
    ("bad", "line"), BAD_MOTIONS.values(), ids=[name.replace(" ", "_") for name in BAD_MOTIONS]
)


@pytest.fixture(autouse=True)
def _no_defaults(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    for name in ("ORIENTD_SOCKET", "ORIENTD_CONFIG"):
        monkeypatch.delenv(name, raising=False)


def write(folder, content):
    path = folder / "motion.json"
    path.write_text(json.dumps(content))
    return path


@each
def test_a_plan_of_a_bad_file_is_refused(tmp_path, bad, line):
    path = write(tmp_path, bad)
    result = inside("plan", path)
    assert (result.returncode, result.stdout) == (1, "")
    # What the file says wrongly is said with its name; what cannot be planned is not.
    message = result.stderr.removeprefix("orientd: ")
    assert message.removeprefix(f"{path}: ").startswith(line)
    assert result.stderr.count("\n") == 1


@each
def test_a_move_of_a_bad_file_is_refused(daemon, tmp_path, bad, line):
    path = write(tmp_path, bad)
    result = inside("move", path, "--socket", daemon.socket, "--json")
    assert (result.returncode, result.stdout) == (1, "")
    error = json.loads(result.stderr)["error"]
    assert error["message"].removeprefix(f"{path}: ").startswith(line)
    assert error.get("field", "") == (line.split(":")[0] if error["kind"] == "RequestError" else "")


@each
def test_a_bad_message_is_refused_in_the_words_of_the_file(daemon, bad, line):
    with package.connect(daemon.socket) as robot:
        request = pb.PlanRequest(motion=json.dumps(bad).encode())
        with pytest.raises((RequestError, OrientdError)) as caught:
            robot._connection.call(robot._stub.Plan, request)
    assert str(caught.value).startswith(line)


def test_a_motion_that_begins_elsewhere_is_refused(daemon, tmp_path):
    path = write(tmp_path, motion({**TURNED, "time": 0}, {**UPRIGHT, "time": 5}))
    assert_refused(orientd("move", path, "--socket", daemon.socket), "orientation by 0.5 rad")


def test_a_bad_file_is_refused_in_a_process_of_its_own(daemon, tmp_path):
    bad, line = BAD_MOTIONS["norm"]
    path = write(tmp_path, bad)
    assert_refused(orientd("plan", path), line)
    assert_refused(orientd("move", path, "--socket", daemon.socket), line)


@pytest.mark.parametrize(
    "arguments",
    [
        ["status"],
        ["devices"],
        ["stop"],
        ["pause"],
        ["resume"],
        ["speed", "0.5"],
        ["enable"],
        ["disable"],
        ["reset"],
        ["view", "--no-open"],
    ],
    ids=lambda arguments: arguments[0],
)
def test_a_command_without_a_daemon_says_so(tmp_path, arguments):
    result = inside(*arguments, "--socket", tmp_path / "control.sock")
    assert (result.returncode, result.stdout) == (1, "")
    assert result.stderr == (
        f"orientd: no daemon answers at {tmp_path}/control.sock; start one with `orientd run`\n"
    )


def test_a_taken_lease_is_said_with_its_holder(daemon, tmp_path):
    path = write(tmp_path, motion(UPRIGHT, TURNED))
    with package.connect(daemon.socket, holder="ana") as robot:
        robot.acquire_lease()
        for arguments in (["move", path], ["enable"], ["pause"], ["speed", "0.5"]):
            result = inside(*arguments, "--socket", daemon.socket)
            assert (result.returncode, result.stdout) == (1, "")
            assert result.stderr.startswith(
                f"orientd: the lease is held by 'ana' (user:{os.getuid()}), for another "
            )


@pytest.mark.parametrize(
    "arguments", [["enable"], ["stop"], ["pause"], ["move"]], ids=lambda arguments: arguments[0]
)
def test_an_unknown_device_is_said_with_those_there_are(daemon, tmp_path, arguments):
    file = [write(tmp_path, motion(UPRIGHT, TURNED))] if arguments == ["move"] else []
    result = inside(*arguments, *file, "--device", "leg", "--socket", daemon.socket)
    assert (result.returncode, result.stdout) == (1, "")
    assert result.stderr == "orientd: device: expected one of arm, got 'leg'\n"


@pytest.mark.parametrize(
    "arguments",
    [
        ["nonsense"],
        ["plan"],
        ["speed", "fast"],
        ["status", "--nonsense"],
        ["plan", "m.yaml", "-o", "m.txt"],
        ["move", "m.yaml", "--blend", "5"],
        ["move", "m.yaml", "--queue", "--blend", "nan"],
        ["move", "m.yaml", "--start-in", "nan"],
        ["move", "m.yaml", "--start-in", "-1"],
        ["move", "m.yaml", "--on-target", "0.1,0.5"],
        ["move", "m.yaml", "--on-target", "0.1,0.5,nan"],
        ["record", "run.txt"],
        ["record", "run.mcap", "--seconds", "nan"],
        ["sim", "base", "--rate", "nan"],
        ["replay", "run.csv", "-o", "motion.txt"],
        ["doctor", "--latency", "arm"],
        ["lease", "seize"],
    ],
    ids=lambda arguments: " ".join(arguments),
)
def test_a_mistake_in_the_command_line_is_one_line_and_status_2(arguments):
    if arguments[0] == "replay":
        pytest.importorskip("mcap")
    assert_refused(inside(*arguments), "; see `orientd ", "--help`", status=2)
    told = inside(*arguments, "--json")
    assert (told.returncode, told.stdout) == (2, "")
    assert json.loads(told.stderr)["error"]["kind"] == "UsageError"


def test_a_wrong_speed_is_refused_for_what_it_is(daemon):
    done = inside("speed", "-1", "--socket", daemon.socket)
    assert_refused(done, "speed: expected more than 0 and at most 1, got -1")


@pytest.mark.parametrize("moment", [float("nan"), float("inf"), "soon"])
def test_a_start_that_is_no_time_is_refused(daemon, moment):
    with (
        package.connect(daemon.socket) as robot,
        pytest.raises(RequestError, match="start_time: expected seconds, got "),
    ):
        robot.move([TURNED], start_time=moment)


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("angular_velocity", [1.0, 2.0]),
        ("angular_velocity", "fast"),
        ("velocity_frame", "tool"),
        ("time_ns", 1.5),
        ("time_to_live", "soon"),
    ],
)
def test_a_target_that_is_not_well_formed_is_refused(daemon, field, value):
    with package.connect(daemon.socket) as robot, robot.track() as tracking:
        fields = {"angular_velocity": [0.0, 0.0, 1.0], field: value}
        with pytest.raises(RequestError, match=f"target.{field}: expected .*, got "):
            tracking.aim(UPRIGHT, **fields)


def test_help_is_never_cut_short():
    for group in ([], ["lease"], ["service"], ["sim"]):
        listed = inside(*group, "--help").stdout.split("Commands:")[1]
        assert "..." not in listed, group


INTERRUPTED_WHILE_LOADING = """
import os, signal, sys
from orientd.cli.start import main

class Interrupt:
    def find_spec(self, name, *_):
        if name == "click":
            os.kill(os.getpid(), signal.SIGINT)

sys.meta_path.insert(0, Interrupt())
signal.signal(signal.SIGINT, signal.default_int_handler)
main()
"""


def test_ctrl_c_while_modules_are_loaded_is_one_line():
    done = subprocess.run(
        [sys.executable, "-c", INTERRUPTED_WHILE_LOADING, "status"],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "orientd: interrupted\n")


INTERRUPTED_BEFORE_THE_COMMAND = """
import os, signal
import click
from orientd.cli.start import main

class Context(click.Context):
    def __init__(self, *arguments, **more):
        os.kill(os.getpid(), signal.SIGINT)
        super().__init__(*arguments, **more)

click.Command.context_class = Context
signal.signal(signal.SIGINT, signal.default_int_handler)
main()
"""

INTERRUPTED_BEHIND_THE_COMMAND = """
import atexit, os, signal
from orientd.cli.start import main

atexit.register(os.kill, os.getpid(), signal.SIGINT)
signal.signal(signal.SIGINT, signal.default_int_handler)
main()
"""


INTERRUPTED_WITHIN_CODE_OF_A_STRING = """
import os, signal, sys

class Interrupt:
    def find_spec(self, name, *_):
        if name == "orientd.cli.commands.daemon_commands":
            exec("os.kill(os.getpid(), signal.SIGINT)")

sys.meta_path.insert(0, Interrupt())
"""


@pytest.mark.real
def test_ctrl_c_while_a_class_is_made_is_no_death_by_a_signal(tmp_path):
    (tmp_path / "sitecustomize.py").write_text(INTERRUPTED_WITHIN_CODE_OF_A_STRING)
    done = orientd("status", env=environment(PYTHONPATH=str(tmp_path)))
    assert_refused(done, "interrupted", status=130)


@pytest.mark.parametrize(
    ("program", "reason", "status"),
    [
        (INTERRUPTED_BEFORE_THE_COMMAND, "interrupted", 130),
        (INTERRUPTED_BEHIND_THE_COMMAND, "no daemon answers", 1),
    ],
    ids=["before", "behind"],
)
def test_ctrl_c_around_the_command_is_one_line(tmp_path, program, reason, status):
    done = subprocess.run(
        [sys.executable, "-c", program, "status", "--socket", str(tmp_path / "none.sock")],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert_refused(done, reason, status=status)


def is_moving(device):
    return device.state == pb.STATE_STREAMING and device.path_time > 0.5


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_to_a_move_stops_the_motion_on_its_path(daemon, tmp_path, number):
    path = write(
        tmp_path,
        motion(
            {"rotation_vector": [0, 0, 0.2], "time": 0},
            {"rotation_vector": [0, 0.4, 1], "time": 20},
            approach=True,
        ),
    )
    before = daemon.device().motion_number
    process = begin("move", path, "--socket", daemon.socket)
    until(
        lambda: (now := daemon.device()).motion_number > before and is_moving(now),
        "motion",
    )
    process.send_signal(number)
    output, errors = process.communicate(timeout=20)
    assert process.returncode == 1
    assert "Traceback" not in errors
    (line,) = errors.splitlines()
    assert line.startswith("orientd: motion ")
    assert re.fullmatch(rf"orientd: motion \d+ stopped by .*\(user:{os.getuid()}\)", line)
    assert ": stopped by" in output
    device = daemon.device()
    assert device.state == pb.STATE_HOLDING
    assert device.path_time < device.duration
    assert not daemon.stub.GetState(pb.GetStateRequest()).daemon.leases
    assert not list(daemon.socket.parent.glob("control.sock.lease*"))


@pytest.mark.real
def test_ctrl_c_twice_ends_a_move_with_its_exit_status(daemon, tmp_path):
    turn = {"rotation_vector": [0, 0.4, 1], "time": 20}
    path = write(tmp_path, motion({"rotation_vector": [0, 0, 0.2], "time": 0}, turn, approach=True))
    before = daemon.device().motion_number
    process = begin("move", path, "--socket", daemon.socket)
    until(
        lambda: (now := daemon.device()).motion_number > before and is_moving(now),
        "motion",
    )
    process.send_signal(signal.SIGINT)
    until(lambda: daemon.device().state != pb.STATE_STREAMING, "a stop")
    while process.poll() is None:
        process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=20)
    assert process.returncode == 1
    (line,) = errors.splitlines()
    assert line.startswith("orientd: motion ")


@pytest.mark.real
def test_whoever_has_read_enough_hears_no_complaint(tmp_path):
    path = write(tmp_path, motion(UPRIGHT, TURNED))
    process = begin("plan", path)
    process.stdout.close()
    errors = process.stderr.read()
    process.stderr.close()
    assert process.wait(20) == 1
    assert errors == ""
    assert not is_alive(process.pid)
