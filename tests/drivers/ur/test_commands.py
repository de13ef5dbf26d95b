"""The commands of the README, from an emulated robot to one that has turned."""

import subprocess
import sys
from pathlib import Path

import pytest

from emulated_ur import EmulatedRobot

pytest.importorskip("rtde_control")

CONFIG = Path(__file__).parents[3] / "config"
COMMAND = (sys.executable, "-m", "orientd")


@pytest.mark.slow
def test_the_example_turns_the_emulated_arm(ur_host, tmp_path):
    config, socket = tmp_path / "ur.toml", tmp_path / "control.sock"
    text = (CONFIG / "ur.toml").read_text()
    for given, patient in (
        ("127.0.0.2", ur_host),
        ("feedback_timeout = 0.1 ", "feedback_timeout = 0.4 "),
        ("watchdog_hz = 10 ", "watchdog_hz = 1.5 "),
    ):
        assert given in text
        text = text.replace(given, patient)
    config.write_text(text)
    with EmulatedRobot(ur_host) as robot:
        daemon = subprocess.Popen(
            [*COMMAND, "run", "--config", config, "--socket", socket, "--until-end-of-input"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
        )
        with daemon:
            assert daemon.stdout.readline().startswith(b"ready")
            before = robot.state()
            done = subprocess.run(
                [*COMMAND, "move", CONFIG / "ur-turn.yaml", "--socket", socket],
                capture_output=True,
                text=True,
                timeout=60.0,
            )
            daemon.stdin.close()
        assert done.returncode == 0, done.stderr
        assert robot.state()["setpoints"] > before["setpoints"] + 500
        assert robot.state()["safety_mode"] == "NORMAL"
