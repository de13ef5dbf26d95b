"""Cells of real daemons on this machine, over Unix sockets or over TLS with a router."""

import contextlib
import os
import signal
import subprocess
import sys
from pathlib import Path

from authority import Authority
from harness import free_port

from orientd_fleet.client import connect_fleet

CELL = "lab"
AHEAD = ["unshare", "--time", "--monotonic"]
"""Runs a command with a clock of its own, where the kernel and the user's rights permit."""
ROLES = {"watcher": "observer", "pendant": "operator", "chief": "administrator"}


def can_have_own_clocks():
    done = subprocess.run([*AHEAD, "1", "true"], check=False, stderr=subprocess.DEVNULL)
    return done.returncode == 0


def gateway_of(name):
    """Return what the gateway of a daemon is called among the processes of a cell."""
    return f"{name}.gateway"


@contextlib.contextmanager
def hanging(cell, name):
    """Let a process of a cell hang for as long as a block."""
    process = cell.processes[name]
    process.send_signal(signal.SIGSTOP)
    try:
        yield
    finally:
        process.send_signal(signal.SIGCONT)


class RunningCell:
    """Daemons ``arm-1``, ``arm-2`` ... with a loopback device ``arm`` and a gateway each."""

    def __init__(
        self,
        folder,
        daemons,
        *,
        is_tls=False,
        lease=1.0,
        more="",
        ahead=None,
        host="127.0.0.1",
        prefix=(),
    ):
        """Prepare them.

        Args:
            ahead: by name, how far monotonic clocks are ahead of ours, s.
            host: where the router listens.
            prefix: of the commands that run daemons and the router.
        """
        self.folder, self.is_tls, self.lease, self.more = Path(folder), is_tls, lease, more
        self.ahead, self.prefix = ahead or {}, prefix
        self.names = [f"arm-{number}" for number in range(1, daemons + 1)]
        self.processes, self.host, self.ports = {}, host, {}
        if is_tls:
            self.authority = Authority(self.folder / "ca")
            for name in (*self.names, "router"):
                self.authority.issue(name, hosts=f"IP:{host}", use="member")
            for name in (*ROLES, "unknown"):
                self.authority.issue(name)
            self.router = f"tls/{host}:{free_port()}"
            self.endpoint = self.router
        else:
            self.endpoint = self.socket_of(self.names[0])

    def address(self, name):
        """Return where a daemon takes calls, in a cell with TLS."""
        return f"{self.host}:{self.ports.setdefault(name, free_port())}"

    def socket_of(self, name):
        return f"unixsock-stream/{self.folder}/{name}.zenoh"

    def files(self, name, folder="ca"):
        ca = self.folder / folder
        return {"certificate": ca / f"{name}.pem", "key": ca / f"{name}.key", "ca": ca / "ca.pem"}

    def fleet(self, name="pendant", **more):
        files = self.files(name) if self.is_tls else {}
        return connect_fleet(self.endpoint, cell=CELL, **files, **{"wait_for": self.names, **more})

    def control(self, name):
        return self.folder / f"{name}.sock"

    def log(self, name):
        return (self.folder / f"{name}.log").read_text()

    def _table(self, name):
        text = f'[fleet]\ncell = "{CELL}"\nname = "{name}"\n'
        if not self.is_tls:
            connect = [self.endpoint] if name != self.names[0] else []
            return f"{text}listen = ['{self.socket_of(name)}']\nconnect = {connect}\n"
        where = f"{'listen' if name == 'router' else 'connect'} = ['{self.router}']\n"
        files = "".join(f"{key} = '{path}'\n" for key, path in self.files(name).items())
        whom = f"daemons = {self.names}\n" if name == "router" else "routers = ['router']\n"
        roles = "".join(f"{who} = '{role}'\n" for who, role in ROLES.items())
        tcp = f"[tcp]\nlisten = '{self.address(name)}'\n{files}" if name != "router" else ""
        return f"{text}{where}{files}{whom}[access.certificates]\n{roles}{tcp}"

    def _clock(self, name):
        ahead = self.ahead.get(name)
        return [] if ahead is None else [*AHEAD, str(round(ahead))]

    def start(self, name):
        """Start a daemon, or the router."""
        config = self.folder / f"{name}.toml"
        text = self._table(name)
        if name != "router":
            text = (
                f'[daemon]\nsocket = "{self.control(name)}"\nlease_seconds = {self.lease}\n{text}'
                '[planner]\nprocesses = 1\n[devices.arm]\ndriver = "loopback"\n'
                "stall_timeout = 5.0\nheartbeat_timeout = 5.0\nfeedback_timeout = 5.0\n" + self.more
            )
        config.write_text(text)
        command = ["run"] if name != "router" else ["fleet", "router"]
        return self._begin(name, name, *command)

    def start_again(self, name):
        """Start a daemon with its configuration as it is now."""
        return self._begin(name, name, "run")

    def start_gateway(self, name):
        """Start the gateway of a daemon, which need not run yet."""
        return self._begin(gateway_of(name), name, "fleet", "serve")

    def _begin(self, process, name, *command):
        with (self.folder / f"{process}.log").open("ab") as log:
            self.processes[process] = subprocess.Popen(
                [
                    *self.prefix,
                    *self._clock(name),
                    sys.executable,
                    "-m",
                    "orientd",
                    *command,
                    "-c",
                    self.folder / f"{name}.toml",
                ],
                stdout=subprocess.PIPE,
                stderr=log,
                text=True,
                env={**os.environ, "XDG_STATE_HOME": str(self.folder / name)},
            )
        return self.processes[process]

    def await_ready(self, name):
        line = self.processes[name].stdout.readline()
        assert line.startswith("ready"), (line, (self.folder / f"{name}.log").read_text())

    def end(self, name, number=signal.SIGTERM):
        process = self.processes.pop(name)
        process.send_signal(number)
        try:
            process.wait(30.0)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
            raise
        finally:
            process.stdout.close()

    def __enter__(self):
        try:
            names = [*(("router",) if self.is_tls else ()), *self.names]
            for name in names:
                self.start(name)
            for name in self.names:
                self.start_gateway(name)
            for name in [*names, *map(gateway_of, self.names)]:
                self.await_ready(name)
        except BaseException:
            self.__exit__()
            raise
        return self

    def __exit__(self, *_):
        with contextlib.ExitStack() as ends:
            for name in list(self.processes):
                ends.callback(self.end, name)
