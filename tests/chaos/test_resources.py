"""Lack of shared memory, disk space and descriptors; run with `make chaos`.

Each daemon has its own file systems in its own mount namespace.  The tests reach them through the
root of the daemon in /proc.
"""

import os
import resource
import subprocess
import time
from pathlib import Path

import grpc
import pytest
from command_line import COMMAND, environment
from harness import DaemonProcess, is_alive
from scenes import under_way
from stage import Stage, rehearse
from tally import Tally, rounds_of

pytestmark = [pytest.mark.chaos, pytest.mark.timeout(7200)]

HOLDS = "motion within limits or a plain refusal, every call answered, status, recovery"


def has_namespaces():
    """Whether this user may mount file systems in a private namespace."""
    try:
        return subprocess.run(["unshare", "-m", "true"], capture_output=True).returncode == 0
    except FileNotFoundError:
        return False


def mounting(*where, size="48m"):
    """Return what runs a command with small file systems at *where*."""
    mounts = " && ".join(f"mount -t tmpfs -o size={size} tmpfs '{path}'" for path in where)
    return ("unshare", "-m", "sh", "-c", f'{mounts} && exec "$@"', "sh")


def inside_of(stage, path):
    """Return *path* as the daemon sees it."""
    return Path(f"/proc/{stage.daemon.process.pid}/root{path}")


def fill(folder):
    """Leave no byte in the file system of *folder*."""
    path = folder / "ballast"
    with path.open("wb", buffering=0) as file:
        for size in (1 << 20, 4096, 1):
            try:
                while True:
                    file.write(bytes(size))
            except OSError:
                continue
    return path


def skip_without_namespaces(tally, name):
    if not has_namespaces():
        tally.skip(name, "this user may not make mount namespaces")


def test_shared_memory_is_full(tmp_path):
    tally = Tally("/dev/shm full in motion, then servo: SIGKILL", 40, "the motion continues "
                  "within limits, status, reset, a motion")  # fmt: skip
    skip_without_namespaces(tally, "shm-full")

    def harm(stage, number, generator):
        try:
            with under_way(stage, number, generator):
                ballast = fill(inside_of(stage, "/dev/shm"))
                time.sleep(0.3)
            stage.come_to_rest()
            stage.streams.clear()
            stage.check_truth(faults=("none",))
            os.kill(stage.servo, 9)
            stage.await_fault()
            stage.settle(faults=("servo_died",))
        finally:
            ballast.unlink(missing_ok=True)

    rehearse(tmp_path, "shm-full", tally, harm, prefix=mounting("/dev/shm", size="20m"))


def test_a_daemon_is_started_where_shared_memory_is_full(tmp_path):
    tally = Tally("/dev/shm full when the daemon starts", 41, "refusal in one line, no socket "
                  "left")  # fmt: skip
    skip_without_namespaces(tally, "shm-start")

    def one(number, generator):
        daemon = DaemonProcess(tmp_path / str(number))
        prefix = mounting("/dev/shm", size=f"{generator.randrange(1, 250) * 4}k")
        done = subprocess.run(
            [*prefix, *COMMAND, "run", "--config", str(daemon.config)],
            capture_output=True,
            text=True,
            timeout=30.0,
            env=environment(XDG_STATE_HOME=str(tmp_path)),
        )
        assert done.returncode == 1, done
        last = done.stderr.splitlines()[-1]
        assert last.startswith("orientd: no shared memory for the servo process"), done.stderr
        assert "Traceback" not in done.stderr, done.stderr
        assert not list(daemon.folder.glob("*.sock*"))

    rounds_of("shm-start", tally, one)


def test_the_disk_is_full(tmp_path):
    tally = Tally("disk full under state and recordings, then servo: SIGKILL", 42, HOLDS)
    skip_without_namespaces(tally, "disk-full")
    state = tmp_path / "state"
    state.mkdir()

    def harm(stage, number, generator):
        try:
            with under_way(stage, number, generator):
                ballast = fill(inside_of(stage, state))
                time.sleep(0.1)
                os.kill(stage.servo, 9)
                stage.await_fault()
            stage.settle(faults=("servo_died",))
        finally:
            ballast.unlink(missing_ok=True)

    rehearse(tmp_path, "disk-full", tally, harm, prefix=mounting(state, size="4m"))


def test_the_setpoints_of_a_recording_driver_find_no_room(tmp_path):
    tally = Tally("disk full under the driver's own recording", 43, "fault internal that names the "
                  "cause, status, reset refused or done, recovery")  # fmt: skip
    skip_without_namespaces(tally, "driver-disk-full")
    folder = tmp_path / "small"
    folder.mkdir()

    def one(number, generator):
        with stage.round():
            with under_way(stage, 0, generator):
                ballast = fill(inside_of(stage, folder))
                try:
                    stage.await_fault()
                finally:
                    text = stage.device().fault_text
                    ballast.unlink()
            assert "No space left" in text, text
            stage.streams.clear()
            stage.check_truth(faults=("internal",))
            os.truncate(stage.daemon.recording, 0)
            stage.recover()

    stage = Stage(tmp_path, tally, prefix=mounting(folder, size="2m"))
    old = stage.daemon.recording
    stage.daemon.config.write_text(
        stage.daemon.config.read_text().replace(str(old), str(folder / "sent"))
    )
    daemon = stage.daemon

    class Inside:
        """The recording as it is seen from outside, whichever daemon it is."""

        def __fspath__(self):
            return f"/proc/{daemon.process.pid}/root{folder}/sent"

    daemon.recording = Inside()
    with stage:
        rounds_of("driver-disk-full", tally, one)


def test_descriptors_run_out(tmp_path):
    tally = Tally("no descriptors left (RLIMIT_NOFILE), then servo: SIGKILL", 44, "motion within "
                  "limits, plain refusals, status, recovery with free descriptors")  # fmt: skip

    def one(number, generator):
        pid = stage.daemon.process.pid
        usual = resource.prlimit(pid, resource.RLIMIT_NOFILE)
        with stage.round():
            try:
                with under_way(stage, number, generator):
                    used = len(os.listdir(f"/proc/{pid}/fd"))
                    room = generator.choice((0, 1, 2, 4))
                    resource.prlimit(pid, resource.RLIMIT_NOFILE, (used + room, usual[1]))
                    time.sleep(0.2)
                    servo = stage.servo
                    assert is_alive(servo)
                    os.kill(servo, 9)
                    stage.await_fault()
                stage.streams.clear()
                stage.check_sent()
                answer = "reset done"
                try:
                    stage.command("Reset")
                except grpc.RpcError as error:
                    answer = f"reset {error.code().name.lower()}"
                tally.met[answer] += 1
                assert answer in ("reset done", "reset unavailable")
            finally:
                resource.prlimit(pid, resource.RLIMIT_NOFILE, usual)
            stage.recover()

    with Stage(tmp_path, tally) as stage:
        rounds_of("descriptors", tally, one)
