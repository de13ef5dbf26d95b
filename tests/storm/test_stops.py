"""How soon a stop reaches the servo while its daemon is attacked.

``ORIENTD_STORM_STOPS`` is how many stops of each way there are under each attack (100).  Run by
``make storm``, or:
``python -m pytest tests/storm/test_stops.py -m storm --timeout=0 -s``.
"""

import contextlib
import itertools
import os
import resource
import signal
import socket
import subprocess
import sys
import threading
import time

import grpc
import numpy as np
import pytest
from authority import OPENSSL, Authority
from browser import CHROMIUM, open_browser, page_of, view_of
from command_line import orientd as orientd_command
from harness import DEVICE, DaemonProcess, free_port, resident_kib, spin, until

import orientd
from orientd.client.stop_call import ask_to_stop
from orientd.protocol import control_pb2 as pb
from orientd.protocol.stub import control_stub

pytestmark = [
    pytest.mark.storm,
    pytest.mark.skipif(OPENSSL is None, reason="there is no openssl here"),
]

ROUNDS = int(os.environ.get("ORIENTD_STORM_STOPS", "100"))
ADMISSION = 2.0
"""Until a new client has been answered, s."""
MEMORY = 256 * 1024
"""That the daemon may have used, KiB."""


@pytest.fixture(scope="module")
def daemon(tmp_path_factory):
    folder = tmp_path_factory.mktemp("daemon")
    state = folder / "state"
    state.mkdir(mode=0o700)
    small = ["mount", "-t", "tmpfs", "-o", "size=64m,mode=700", "tmpfs", str(state)]
    is_small = os.getuid() == 0 and subprocess.run(small, check=False).returncode == 0
    authority = Authority(folder / "ca")
    authority.issue("server", hosts="IP:127.0.0.1")
    process = DaemonProcess(folder, lease=3600.0, patience=30.0)
    process.port = free_port()
    text = process.config.read_text()
    ca = folder / "ca"
    process.config.write_text(
        f"[tcp]\nlisten = '127.0.0.1:{process.port}'\ncertificate = '{ca}/server.pem'\n"
        f"key = '{ca}/server.key'\nca = '{ca}/ca.pem'\n{text}"
    )
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (hard, hard))
    with process:
        yield process
    resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))
    if is_small:
        subprocess.run(["umount", "--lazy", str(state)], check=True)


@contextlib.contextmanager
def nothing(daemon):
    yield


@contextlib.contextmanager
def hanging(daemon):
    """Stop the whole daemon, as a debugger does; it continues to report the stop."""
    daemon.process.send_signal(signal.SIGSTOP)
    try:
        yield
    finally:
        daemon.process.send_signal(signal.SIGCONT)


@contextlib.contextmanager
def connections(daemon, count=1000, family=socket.AF_UNIX):
    """Have so many connections that say nothing."""
    at = str(daemon.socket) if family == socket.AF_UNIX else ("127.0.0.1", daemon.port)
    with contextlib.ExitStack() as stack:
        for _ in range(count):
            one = stack.enter_context(socket.socket(family))
            one.setblocking(False)
            with contextlib.suppress(BlockingIOError):
                one.connect(at)
        yield


COUNTS = itertools.cycle([40, 400, 4000])


def handshakes(daemon):
    """Have so many connections over TCP that never begin their handshake."""
    return connections(daemon, next(COUNTS), socket.AF_INET)


@contextlib.contextmanager
def plans(daemon):
    """Have 100 large plans wait."""
    motion = spin(8000.0)
    with grpc.insecure_channel(f"unix:{daemon.socket}") as channel:
        stub = control_stub(channel)
        asked = [stub.Plan.future(pb.PlanRequest(motion=motion)) for _ in range(100)]
        yield
        for one in asked:
            one.cancel()


@contextlib.contextmanager
def watchers(daemon):
    """Have 120 watchers that do not read, in a process of their own."""
    program = (
        "import sys, grpc; from orientd.protocol import control_pb2 as pb\n"
        "from orientd.protocol import control_stub\n"
        "stub = control_stub(grpc.insecure_channel('unix:' + sys.argv[1]))\n"
        "kept = [stub.WatchState(pb.WatchStateRequest(rate_hz=100.0)) for _ in range(120)]\n"
        "print('ready', flush=True); sys.stdin.read()"
    )
    command = [sys.executable, "-c", program, str(daemon.socket)]
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
    with subprocess.Popen(command, **pipes) as process:
        assert process.stdout.readline() == b"ready\n"
        yield
        process.kill()


@contextlib.contextmanager
def without_descriptors(daemon):
    pid = daemon.process.pid
    before = resource.prlimit(pid, resource.RLIMIT_NOFILE)
    resource.prlimit(pid, resource.RLIMIT_NOFILE, (8, before[1]))
    try:
        yield
    finally:
        resource.prlimit(pid, resource.RLIMIT_NOFILE, before)


@contextlib.contextmanager
def full_disk(daemon):
    """Fill the file system with the daemon's audit log and recordings."""
    state = daemon.folder / "state"
    if not state.is_mount():
        pytest.skip("mounting a small file system is for root")
    filling = state / "filling"
    with filling.open("wb", buffering=0) as file, contextlib.suppress(OSError):
        while True:
            file.write(bytes(1 << 20))
    yield
    filling.unlink()


class Cycles:
    """The newest cycles of the device, from before an attack on."""

    def __init__(self, daemon):
        self.stream = daemon.stub.WatchState(pb.WatchStateRequest(rate_hz=50.0))
        self.seen = []
        threading.Thread(target=self._read, daemon=True).start()

    def _read(self):
        with contextlib.suppress(grpc.RpcError):
            for batch in self.stream:
                self.seen = (self.seen + list(batch.cycles))[-5000:]

    def braking(self, since_ns):
        """Return when the first cycle since then was due that brakes, monotonic clock, ns."""
        after = [one for one in self.seen if one.deadline_ns > since_ns - 10_000_000]
        return next((one.deadline_ns for one in after if one.state == pb.STATE_STOPPING), None)


ATTACKS = [
    nothing, hanging, connections, handshakes, plans, watchers, without_descriptors, full_disk,
]  # fmt: skip
ADMITTING = [nothing, connections, handshakes, plans, watchers, full_disk]
"""Under which a client that may come in is answered."""


def admitted(daemon):
    """Return how long a new client waits for its first answer, s."""
    begun = time.monotonic()
    with orientd.connect(daemon.socket) as robot:
        robot.state()
    return time.monotonic() - begun


def by_call(daemon, kind):
    asked = time.monotonic_ns()
    (met,) = ask_to_stop(daemon.socket, kind)
    assert met["state"] == "STREAMING"
    return asked


def by_command(daemon, kind):
    asked = time.monotonic_ns()
    done = orientd_command(kind, "--socket", daemon.socket)
    assert done.returncode == 0, done.stderr
    return asked


CLICK = """button => {
    const now = performance.timeOrigin + performance.now(); button.click(); return now;
}"""


def by_page(daemon, kind):
    button = daemon.page.get_by_role("button", name=kind.capitalize())
    clicked = button.evaluate(CLICK)
    return round(clicked * 1e6) - time.time_ns() + time.monotonic_ns()


BOUND = 0.05
"""From the call, the start of the command (which has Python to start) or the click in the browser
(which draws without a graphics card meanwhile) to the first cycle that brakes, s."""


@pytest.fixture(params=[by_call, by_command, by_page], ids=lambda way: way.__name__, scope="module")
def way(request, daemon):
    if request.param is not by_page:
        yield request.param
        return
    for module in ("websockets", "playwright.sync_api"):
        pytest.importorskip(module)
    if CHROMIUM is None:
        pytest.skip("needs Chromium (Debian: chromium)")
    with (
        open_browser() as browser,
        view_of(daemon.socket) as view,
        page_of(view, browser, 900, 400) as daemon.page,
    ):
        yield request.param


@pytest.fixture(autouse=True)
def without_fault(daemon):
    """Clear the fault of a test that has failed: the next ones fail for their own reasons."""
    if daemon.device().state == pb.STATE_FAULT:
        daemon.stub.Reset(pb.CommandRequest(lease_token=daemon.token, device=DEVICE))


@pytest.mark.parametrize("attack", ATTACKS, ids=lambda attack: attack.__name__)
def test_a_stop_reaches_the_servo_under_attack(daemon, way, attack):
    cycles, took, waited = Cycles(daemon), [], [0.0]
    for number in range(ROUNDS):
        daemon.move(spin(60.0))
        until(lambda: daemon.device().path_time > 0.05, "motion")
        with attack(daemon):
            if attack in ADMITTING:
                waited.append(admitted(daemon))
            asked = way(daemon, ("stop", "halt")[number % 2])
            if attack is hanging:
                time.sleep(0.2)  # for a client that does not wait for an answer
        *_, last = daemon.stream
        assert last.summary.text.startswith("stopped by "), last.summary
        braked = until(lambda: cycles.braking(asked), "braking")  # noqa: B023
        took.append((braked - asked) * 1e-6)
    cycles.stream.cancel()
    print(
        f"\n{way.__name__}, {attack.__name__}: {ROUNDS} stops, median {np.median(took):.1f} ms, "
        f"slowest {max(took):.1f} ms; admitted in {max(waited):.2f} s; "
        f"the daemon used {(most := resident_kib(daemon.process.pid, 'VmHWM')) / 1024:.0f} MiB"
    )
    assert max(took) <= BOUND * 1e3
    assert max(waited) <= ADMISSION
    assert most <= MEMORY
