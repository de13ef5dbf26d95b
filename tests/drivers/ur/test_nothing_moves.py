"""An arm that was moved by hand stays there, whatever begins again, until somebody asks for more.

The judge is the emulated arm's own record of every joint in every cycle of 2 ms.
"""

import os
import signal
from contextlib import ExitStack, contextmanager, suppress
from itertools import pairwise

import pytest
from arm_recording import read_arm
from ur_rig import device_of, fault_of, is_holding, press, push, streaming, swing, until

from emulated_ur import EmulatedRobot, LaunchError
from orientd.errors import Fault

pytest.importorskip("rtde_control")

pytestmark = pytest.mark.world

HAND = (0.3, -0.3, 0.3, 0.3, 0.3, -0.3)
CYCLE = 0.002
REST = 1e-4


class Bench:
    """A robot that takes servo commands without smoothing, and a device of the daemon on it.

    Attributes:
        robot: the emulated robot.
        device: the device; a case may replace it.
    """

    def __init__(self, host, stack, directory, *options):
        self._host, self._stack, self._stem = host, stack, directory / "arm"
        self.robot = stack.enter_context(EmulatedRobot(host, "--unlock-after", "0.05", *options))
        self._open()
        # The command register holds a setpoint from here on.
        swing(self.device)
        streaming(self.device)

    def _open(self):
        self._daemon = self._stack.enter_context(ExitStack())
        self.device = self._daemon.enter_context(device_of(self._host))

    def restart_daemon(self):
        """End the daemon's part, and start it again."""
        self._daemon.close()
        self.move_by_hand()
        self._open()

    def fault(self, order):
        """Ask for what stops the arm; wait until it stands without a program."""
        self.robot.ask(order)
        fault_of(self.device)
        self.await_stop()

    def await_stop(self):
        self.robot.wait_until(lambda s: s["runtime_state"] == "STOPPED" and s["is_still"])

    def press(self, line):
        """Send a line to the dashboard server; its answer does not matter."""
        press(self._host, line)

    def move_by_hand(self):
        """Move every joint; record the arm from then on."""
        push(self.robot, HAND)
        self.robot.ask("record clear")
        self.robot.ask("record on")

    def pass_ticks(self, count=100):
        begun = self.robot.state()["ticks"]
        self.robot.wait_until(lambda s: s["ticks"] > begun + count)

    def reset(self):
        """Reset the device, and look at it for a while."""
        self.device.reset()
        until(lambda: is_holding(self.device), lambda: f"holding: {self.device.snapshot()}")

    @contextmanager
    def judged(self, case):
        """Look at the arm from the hand's last touch on, also if the case ends with an error."""
        try:
            yield
        finally:
            far, fast = self._travel()
            print(f"\n| {case} | {far:.2e} rad | {fast:.2e} rad/s |")
            assert far < REST, f"moved by {far:.4f} rad, at {fast:.2f} rad/s"

    def _travel(self):
        """Return how far a joint went since the hand, rad, and how fast, rad/s, at the most."""
        self.pass_ticks()
        self.robot.ask(f"record write {self._stem}")
        rows = [row.actual_q for row in read_arm(self._stem)]
        assert len(rows) > 100
        far = max(abs(a - b) for row in rows for a, b in zip(row, rows[0], strict=True))
        steps = pairwise(rows)
        fast = max(abs(a - b) for one in steps for a, b in zip(*one, strict=True)) / CYCLE
        return far, fast


@pytest.fixture
def bench(ur_host, tmp_path):
    with ExitStack() as stack:
        yield lambda *options: Bench(ur_host, stack, tmp_path, *options)


def after(order, release=(), buttons=()):
    """Stop the arm, move it, release the stop, press buttons of the dashboard, reset."""

    def case(bench):
        bench.fault(order)
        bench.move_by_hand()
        for act in release:
            bench.robot.ask(act)
        for button in buttons:
            bench.press(button)
            bench.pass_ticks(60)
        bench.reset()

    return case


def enable(bench):
    until(lambda: is_holding(bench.device), "the end")
    bench.device.disable()
    bench.robot.ask("stop")
    bench.await_stop()
    bench.move_by_hand()
    bench.device.enable()


def end_free(bench):
    until(lambda: is_holding(bench.device), "the end")
    bench.device.disable(is_freed=True)
    bench.move_by_hand()
    bench.device.end_free()


def new_daemon(bench):
    until(lambda: is_holding(bench.device), "the end")
    bench.restart_daemon()


def new_servo(bench):
    os.kill(bench.device.snapshot().servo_pid, signal.SIGKILL)
    bench.await_stop()
    bench.move_by_hand()
    until(lambda: bench.device.snapshot().fault is Fault.SERVO_DIED, "the dead servo")
    bench.reset()


def killed_daemon(bench):
    os.kill(bench.device.snapshot().servo_pid, signal.SIGKILL)
    bench.await_stop()
    bench.restart_daemon()


def frozen(bench):
    bench.robot.ask("freeze")
    fault_of(bench.device)
    bench.robot.ask("thaw")
    bench.await_stop()
    bench.move_by_hand()
    bench.reset()


def lost(bench):
    bench.robot.ask("drop rtde")
    fault_of(bench.device)
    # The client library may have played its program again.
    bench.robot.ask("stop")
    bench.await_stop()
    bench.move_by_hand()
    bench.reset()


def turn_a_little(device):
    """Ask for a motion, which is carried out."""
    swing(device, angle=0.05, seconds=0.6)
    streaming(device)
    until(lambda: is_holding(device), lambda: f"the end: {device.snapshot()}")
    assert device.snapshot().fault is Fault.NONE


CASES = {
    "stop": after("stop"),
    "pause": after("pause"),
    "protective stop": after("protective_stop"),
    "emergency stop": after("emergency_stop", release=["release"]),
    "safeguard": after("safeguard", release=["release"]),
    "violation": after("violation", buttons=["restart safety"]),
    "power": after(
        "emergency_stop", release=["release"], buttons=["power on", "brake release", "play"]
    ),
    "unlock": after("protective_stop", buttons=["unlock protective stop", "play"]),
    "play": after("pause", buttons=["play"]),
    "play after a stop": after("stop", buttons=["play"]),
    "enable": enable,
    "end of hand guiding": end_free,
    "new servo": new_servo,
    "new daemon": new_daemon,
    "killed daemon": killed_daemon,
    "frozen controller": frozen,
    "lost link": lost,
}


QUICK = ("stop", "emergency stop", "play", "enable", "new servo")


@pytest.mark.parametrize(
    "case",
    [case if case in QUICK else pytest.param(case, marks=pytest.mark.slow) for case in CASES],
)
def test_arm_moved_by_hand_stays_until_somebody_asks(bench, case):
    found = bench("--stiff-servo")
    with found.judged(case):
        CASES[case](found)
    turn_a_little(found.device)


@pytest.mark.slow
@pytest.mark.parametrize("leaves", ["playing", "stopped"])
def test_it_stays_whatever_a_protective_stop_leaves_of_the_program(bench, leaves):
    found = bench("--stiff-servo", "--protective-stop-leaves", leaves)
    with found.judged("unlock"):
        CASES["unlock"](found)


@pytest.mark.parametrize("plays", [True, pytest.param(False, marks=pytest.mark.slow)])
def test_it_stays_without_a_dashboard_that_ends_the_paused_program(bench, plays):
    found = bench("--stiff-servo", "--polyscope", "10.11")
    with found.judged(f"pause{', play' * plays}, PolyScope X"):
        found.fault("pause")
        found.pass_ticks(60)  # the empty program holds the arm for a moment
        found.move_by_hand()
        if plays:
            with suppress(LaunchError):  # there is nothing to play
                found.robot.ask("play")
            found.pass_ticks(60)
        found.reset()
    turn_a_little(found.device)


@pytest.mark.slow
def test_a_program_that_a_safety_stop_holds_is_ended_once_that_is_released(bench):
    found = bench("--stiff-servo", "--polyscope", "10.11")
    found.robot.ask("safeguard")
    fault_of(found.device)
    found.robot.wait_until(lambda s: s["runtime_state"] == "PAUSED" and s["is_still"])
    found.robot.ask("release")
    found.await_stop()
    found.pass_ticks(60)
    found.move_by_hand()
    with found.judged("safeguard, play, PolyScope X"):
        with suppress(LaunchError):  # there is nothing to play
            found.robot.ask("play")
        found.reset()


@pytest.mark.slow
def test_it_stays_on_a_controller_that_smooths(bench):
    found = bench()
    with found.judged("stop"):
        CASES["stop"](found)
