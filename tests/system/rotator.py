"""`orientd serve rotctld` in a process of its own, and a client that reads it line by line."""

import contextlib
import signal
import socket

from command_line import begin
from harness import until


class Client:
    """A client that reads the answers line by line."""

    def __init__(self, port):
        self.port = port
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

    def close(self):
        self.lines.close()
        self.socket.close()


@contextlib.contextmanager
def rotctld(daemon, *arguments):
    """Serve a daemon's device; yield a client."""
    server = begin("serve", "rotctld", "--port", 0, "--socket", daemon.socket, *arguments)
    if "--ephemeris" in arguments:
        assert "the target is known to" in server.stdout.readline()
    line = server.stdout.readline()
    assert line.startswith("ready at "), (line, server.stderr.read())
    client = Client(int(line.split()[2].rpartition(":")[2]))
    client.server = server
    try:
        yield client
    finally:
        client.close()
        server.send_signal(signal.SIGINT)
        output, errors = server.communicate(timeout=30.0)
        print(output)  # pytest shows it if the test fails
        assert (server.returncode, errors) == (0, "")
