"""`orientd serve rotctld` over its socket, against a daemon in a process of its own."""

import contextlib
import signal
import socket

from command_line import begin
from harness import until


class Client:
    """A client that reads the answers line by line."""

    def __init__(self, port):
        self.socket = socket.create_connection(("127.0.0.1", port), timeout=30.0)
        self.lines = self.socket.makefile("r", newline="\n")

    def ask(self, text, answers=1):
        self.socket.sendall(f"{text}\n".encode())
        return [self.lines.readline().rstrip("\n") for _ in range(answers)]

    def position(self):
        return tuple(map(float, self.ask("p", 2)))

    def await_position(self, azimuth, elevation):
        def is_there():
            found = self.position()
            return abs(found[0] - azimuth) < 0.05 and abs(found[1] - elevation) < 0.05

        until(is_there, f"{azimuth}, {elevation}")


@contextlib.contextmanager
def rotctld(daemon, *arguments):
    """Serve a daemon's device; yield a client."""
    server = begin("serve", "rotctld", "--port", 0, "--socket", daemon.socket, *arguments)
    line = server.stdout.readline()
    assert line.startswith("ready at "), (line, server.stderr.read())
    client = Client(int(line.split()[2].rpartition(":")[2]))
    try:
        yield client
    finally:
        client.lines.close()
        client.socket.close()
        server.send_signal(signal.SIGINT)
        _, errors = server.communicate(timeout=30.0)
        assert (server.returncode, errors) == (0, "")


def test_north_and_ranges_are_as_given(daemon):
    with rotctld(daemon, "--north", 90, "--azimuth", "0:450", "--elevation", "0:180") as client:
        assert client.ask("P 400 20") == ["RPRT 0"]
        client.await_position(400.0, 20.0)
        assert client.ask("P 451 20") == ["RPRT -1"]
        assert client.ask("P 10 -1") == ["RPRT -1"]
        assert client.ask("P 220 160") == ["RPRT 0"]
        client.await_position(220.0, 160.0)
        x, y, z, w = (daemon.device().cycle.q.__getattribute__(name) for name in "xyzw")
        ahead = (1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y))
        # 40 degrees clockwise from north, which is the world's y axis.
        expected = (0.6040, 0.7198, 0.3420)
        assert all(abs(a - b) < 1e-3 for a, b in zip(ahead, expected, strict=True))
