"""Every example runs: those without a daemon here, the others with `make follow`."""

import json
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from follower import Follower
from pages import Block

EXAMPLES = Path(__file__).parents[2] / "examples"
CONFIG = EXAMPLES.parent / "config"
ONE_DEVICE = "orientd run"
ALONE = {
    "compare_families.py": ["families.svg"],
    "pose_motion.py": ["pose.svg"],
    "replay_ros2_bag.py": ["replayed.json"],
}
"""What each makes."""
WITH_A_DAEMON = {
    "two_arms.py": ["orientd run --config two_arms.toml"],
    "camera_trigger.py": [ONE_DEVICE],
    "track_target.py": [ONE_DEVICE],
    "gimbal_pass.py": [
        "orientd sim dynamixel --link /tmp/gimbal",
        "orientd run --config gimbal.toml",
    ],
}
"""What runs before each."""
SAYS = {
    "two_arms.py": "done, apart by less than 10 ms: True\n" * 2,
    "camera_trigger.py": "picture at 15 degrees",
    "track_target.py": "targets, at the end",
    "gimbal_pass.py": "done",
}
ELSEWHERE = ("curves_as_a_library.py", "own_driver.py")
NOTEBOOKS = sorted(path.name for path in EXAMPLES.glob("*.ipynb"))


def test_every_example_is_run_by_a_test_and_listed():
    found = {path.name for path in EXAMPLES.glob("*.py")}
    assert found == {*ALONE, *WITH_A_DAEMON, *ELSEWHERE}
    listed = (EXAMPLES / "README.md").read_text()
    assert all(f"[{name}]({name})" in listed for name in (*found, *NOTEBOOKS))


@pytest.mark.parametrize("name", [*ALONE, *WITH_A_DAEMON, *ELSEWHERE])
def test_an_example_is_short(name):
    assert len((EXAMPLES / name).read_text().splitlines()) < 60


@pytest.mark.parametrize("name", ALONE)
def test_an_example_without_a_daemon(tmp_path, name):
    if name == "replay_ros2_bag.py":
        pytest.importorskip("rosbags")
    with Follower(tmp_path) as reader:
        reader.do(Block("sh", "", f"python {EXAMPLES / name}", "", name))
    assert all((tmp_path / made).stat().st_size > 500 for made in ALONE[name])


def test_the_driver_of_ones_own_passes_its_test(tmp_path):
    shutil.copy(EXAMPLES / "own_driver.py", tmp_path)
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "own_driver.py"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout


def test_the_package_of_a_driver_is_short_and_passes_its_tests():
    package = EXAMPLES / "feetech_gimbal"
    files = (package / "feetech_gimbal").glob("*.py")
    assert sum(len(file.read_text().splitlines()) for file in files) <= 250
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", str(package)]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout


@pytest.mark.parametrize("name", NOTEBOOKS)
def test_a_notebook_runs_from_top_to_bottom(tmp_path, name):
    cells = json.loads((EXAMPLES / name).read_text())["cells"]
    code = "\n".join("".join(cell["source"]) for cell in cells if cell["cell_type"] == "code")
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr


@pytest.mark.follow
@pytest.mark.parametrize("name", WITH_A_DAEMON)
def test_an_example_with_a_daemon(tmp_path, name):
    for file in (EXAMPLES / "two_arms.toml", CONFIG / "gimbal.toml"):
        (tmp_path / file.name).write_text(file.read_text())
    with Follower(tmp_path) as reader:
        reader.do(Block("toml", "gimbal.toml", (CONFIG / "gimbal.toml").read_text(), "", name))
        for command in WITH_A_DAEMON[name]:
            reader.do(Block("sh", "In a terminal of its own", command, "", name))
        reader.do(Block("sh", "", f"python {EXAMPLES / name}", "", name))
        reader.do(Block("text", "", f"...{SAYS[name].strip()}...", "", name))
