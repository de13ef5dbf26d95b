"""The recipes by trade: their files, programs and commands do what the page says of them."""

import math
import shlex

import harness
import numpy as np
import pytest
from command_line import orientd
from harness import DaemonProcess
from pages import DOCS, blocks

from orientd import rotation
from orientd.protocol import control_pb2 as pb

pytestmark = pytest.mark.world

BLOCKS = blocks(DOCS / "how-to" / "recipes.md")
FILES = {block.caption: block.text for block in BLOCKS if "." in block.caption}
SHELL = [line for block in BLOCKS if block.language == "sh" for line in block.text.splitlines()]
RATE = 500.0


@pytest.fixture(scope="module")
def daemon(tmp_path_factory):
    """A daemon whose device lags as that of the page."""
    with DaemonProcess(tmp_path_factory.mktemp("daemon"), options="delay_cycles = 10") as process:
        process.stub.ReleaseLease(pb.ReleaseLeaseRequest(token=process.token))
        yield process


@pytest.fixture
def shell(daemon, tmp_path):
    """Runs a line of the page in a folder with the files of the page."""
    for name, text in FILES.items():
        (tmp_path / name).write_text(text)

    def run(line):
        assert line in SHELL
        begin = len(daemon.sent())
        environ = {"ORIENTD_SOCKET": str(daemon.socket)}
        _, *words = shlex.split(line)
        done = orientd(*words, cwd=tmp_path, env=environ)
        assert done.returncode == 0, done
        return daemon.sent()[begin:]

    return run


@pytest.fixture
def program(daemon, monkeypatch, capsys):
    """Runs a program of the page; returns what it prints, and the setpoints."""

    def run(name):
        monkeypatch.setenv("ORIENTD_SOCKET", str(daemon.socket))
        begin = len(daemon.sent())
        exec(compile(FILES[name], name, "exec"), {"__name__": "__main__"})
        return capsys.readouterr().out, daemon.sent()[begin:]

    return run


def rates(q):
    """Return the angular velocity between setpoints, about the axes of the tool, rad/s."""
    return rotation.log(rotation.multiply(rotation.conjugate(q[:-1]), q[1:])) * RATE


def moves(q):
    """Return after which setpoints another one follows."""
    return np.flatnonzero(np.any(np.diff(q, axis=0) != 0.0, axis=1))


def moving(q):
    """Return the setpoints from the first that differs from its predecessor to the last."""
    first, *_, last = moves(q)
    return q[first : last + 2]


def test_an_inspection_is_done_once_the_measured_orientation_has_settled(shell):
    sent = shell("orientd move inspect.yaml --on-target 0.2,0.5,0.1")
    # The device is 20 ms behind, and is to be on target for 100 ms.
    assert len(sent) - 1 - moves(sent)[-1] >= 0.12 * RATE
    tool = rotation.rotate(sent[-1], [0.0, 0.0, 1.0])
    assert tool == pytest.approx(np.array([0.5, 0.3, -0.3]) / math.sqrt(0.43), abs=1e-6)


def test_a_pan_has_its_velocity_at_both_ends(shell):
    sent = moving(shell("orientd move pan.yaml"))
    steady = np.flatnonzero(np.linalg.norm(rates(sent) - [0.0, 0.0, 0.2618], axis=-1) < 1e-5)
    assert len(steady) == pytest.approx(4.0 * RATE, abs=2)
    ends = np.degrees(rotation.log(sent[[steady[0], steady[-1] + 1]])[:, 2])
    assert ends == pytest.approx([-30.0, 30.0], abs=0.06)


def test_a_take_is_repeated_exactly(shell):
    """The second and the third take begin at the end of the one before."""
    if harness.MACHINE.is_patient:
        pytest.skip("a busy machine misses cycles")
    _, second, third = (moving(shell("orientd move take.yaml")) for _ in range(3))
    assert np.array_equal(second, third)


def test_a_satellite_pass_starts_at_the_given_instant(shell):
    sent = shell("orientd move pass.yaml --start-in 5")
    begins_late = 15.0 if harness.MACHINE.is_patient else 0.01
    assert -0.01 < moves(sent)[0] / RATE - 5.0 < begins_late
    tool = rotation.rotate(sent[-1], [1.0, 0.0, 0.0])
    azimuth, level = math.radians(70.0), math.cos(math.radians(30.0))
    due = [level * math.cos(azimuth), level * math.sin(azimuth), 0.5]
    assert tool == pytest.approx(due, abs=1e-6)


def test_samples_turn_at_one_rate_and_end_with_done(program):
    output, sent = program("spin_samples.py")
    assert output == "A1 done\nA2 done\n"
    away = np.linalg.norm(rates(sent) - [0.0, 0.0, math.radians(30.0)], axis=-1)
    assert np.count_nonzero(away < 1e-5) == pytest.approx(2 * 3.0 * RATE, abs=4)


def test_the_targets_of_a_policy_are_followed(program):
    output, sent = program("policy.py")
    assert output == "True\n"
    assert rotation.log(sent[-1]) == pytest.approx([0.2, 0.0, 0.4], abs=1e-3)
