"""The commands of the Containerfile, run in a plain environment with the variables of its image."""

import json
import os
import re
import signal
import subprocess
import tempfile
from pathlib import Path

import pytest
from command_line import COMMAND

ROOT = Path(__file__).parents[2]
TEXT = (ROOT / "Containerfile").read_text()
MOUNT = re.search(r"-v \./cell\.toml:(\S+):ro", TEXT)[1]


class Image:
    """The image of the Containerfile, with another folder in place of the root."""

    def __init__(self, folder):
        self.folder = folder
        self.home = self.inside("/var/lib/orientd")
        for name in ("run", "state"):
            (self.home / name).mkdir(parents=True, mode=0o700)
        variables = re.search(r"^ENV ((?:.*\\\n)*.*)$", TEXT, re.MULTILINE)[1]
        self.environment = {"PATH": os.environ["PATH"], "HOME": str(self.home)}
        for name, value in re.findall(r"([A-Z_]+)=(\S+)", variables):
            if name != "PATH":
                self.environment[name] = str(self.inside(value))

    def inside(self, path):
        return self.folder / path.removeprefix("/")

    def begin(self, instruction):
        """Begin the command of CMD or HEALTHCHECK."""
        command = json.loads(re.search(rf"^{instruction}.*(\[.*\])$", TEXT, re.MULTILINE)[1])
        assert command[0] == "orientd"
        arguments = [str(self.inside(one)) if one[0] == "/" else one for one in command[1:]]
        return subprocess.Popen(
            [*COMMAND, *arguments],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            cwd=self.home,
            env=self.environment,
        )

    def run(self, instruction):
        process = self.begin(instruction)
        try:
            output, errors = process.communicate(timeout=30.0)
        finally:
            process.kill()
            process.communicate()
        return process.returncode, output, errors


@pytest.fixture
def image():
    """An image in a folder of a short name: the path of a socket has at most 107 bytes."""
    with tempfile.TemporaryDirectory(prefix="orientd-") as folder:
        yield Image(Path(folder))


def test_the_daemon_of_the_image_reads_the_configuration_that_is_mounted(image):
    file = image.inside(MOUNT)
    file.parent.mkdir(parents=True)
    file.write_text('[devices.mine]\ndriver = "loopback"\n')
    daemon = image.begin("CMD")
    try:
        assert ": mine (loopback, 500 Hz)\n" in daemon.stdout.readline()
        status, output, _ = image.run("HEALTHCHECK")
        assert (status, "mine  loopback" in output) == (0, True)
    finally:
        daemon.send_signal(signal.SIGTERM)
        daemon.communicate(timeout=60.0)
    assert image.run("HEALTHCHECK")[0] == 1


def test_the_daemon_of_the_image_does_not_start_without_a_configuration(image):
    status, output, errors = image.run("CMD")
    assert (status, output) == (1, "")
    assert errors == f"orientd: cannot read {image.inside(MOUNT)}: No such file or directory\n"


def test_the_environment_of_the_readme_is_in_no_image_and_in_no_commit():
    name = re.search(r"python3 -m venv (\w+)", (ROOT / "README.md").read_text())[1]
    assert name in (ROOT / ".dockerignore").read_text().split()
    assert f"/{name}/" in (ROOT / ".gitignore").read_text().split()
