"""Emulated robots, and a controller's ports that answer whatever a test says."""

import contextlib
import itertools
import os
import socket
import threading
import time

import pytest

from emulated_ur import EmulatedRobot

_numbers = itertools.count(1)


@pytest.fixture
def ur_robot():
    """An emulated robot of the world."""
    with EmulatedRobot("127.0.0.7", "--unlock-after", "0.05") as robot:
        yield robot


@pytest.fixture
def peer():
    """Serve a port on an address of its own, and send one answer for everything that comes."""
    run, number = os.getpid(), next(_numbers)
    host, heard, threads = f"127.97.{run % 250 + 1}.{number % 250 + 1}", [], []

    def serve(port, *answers, pause=0.0):
        server = socket.create_server((host, port))

        def run():
            # What nobody asks is not waited for.
            server.settimeout(1.0)
            with server, contextlib.suppress(OSError), server.accept()[0] as client:
                client.settimeout(None)
                for answer in answers:
                    if answer is None:
                        client.recv(4096)
                        continue
                    for chunk in answer if isinstance(answer, list) else [answer]:
                        client.sendall(chunk)
                        time.sleep(pause)
                    heard.append(client.recv(4096))
                client.settimeout(2.0)
                client.recv(1)

        threads.append(threading.Thread(target=run))
        threads[-1].start()
        return host, heard

    yield serve
    for thread in threads:
        thread.join()
