"""Two network namespaces and a link between them that delays, loses and can be cut.

The link carries IP packets from one TUN device to another, so TCP repeats lost packets as on a real
network.  It needs root.  The kernel's scheduler ``netem`` would do the same, but not every kernel
has it.
"""

import ctypes
import fcntl
import heapq
import itertools
import os
import random
import select
import struct
import subprocess
import threading
import time
from pathlib import Path

CLONE_NEWNET = 0x40000000
TUNSETIFF, IFF_TUN, IFF_NO_PI = 0x400454CA, 0x0001, 0x1000
HERE, THERE = "10.99.7.1", "10.99.7.2"


def is_possible():
    return os.geteuid() == 0 and Path("/dev/net/tun").exists()


def _ip(*arguments):
    subprocess.run(["ip", *arguments], check=True)


class LossyNetwork:
    """Namespaces `near` and `far`, which reach each other at HERE and THERE until the end."""

    def __init__(self, *, delay=0.0, jitter=0.0, loss=0.0, seed=1):
        self.delay, self.jitter, self.loss = delay, jitter, loss
        self.is_cut = False
        self.carried = self.lost = 0
        self.near, self.far = (f"orientd-{os.getpid()}-{end}" for end in ("near", "far"))
        self._chance = random.Random(seed)

    def inside(self, name):
        """Return what runs a command in a namespace."""
        return ("ip", "netns", "exec", name)

    def __enter__(self):
        self._ends = []
        for name, address in ((self.near, HERE), (self.far, THERE)):
            _ip("netns", "add", name)
            self._ends.append(self._device(name))
            _ip("-n", name, "link", "set", "lo", "up")
            _ip("-n", name, "address", "add", f"{address}/24", "dev", "wire")
            _ip("-n", name, "link", "set", "wire", "up")
        self._ending = False
        self._thread = threading.Thread(target=self._carry, daemon=True)
        self._thread.start()
        return self

    def __exit__(self, *_):
        self._ending = True
        self._thread.join()
        for end in self._ends:
            os.close(end)
        for name in (self.near, self.far):
            _ip("netns", "delete", name)

    def _device(self, name):
        """Return a TUN device of a namespace; a thread of its own goes there."""
        found = []

        def make():
            with Path(f"/run/netns/{name}").open("rb") as namespace:
                if ctypes.CDLL(None, use_errno=True).setns(namespace.fileno(), CLONE_NEWNET):
                    raise OSError(ctypes.get_errno(), "setns")
            end = os.open("/dev/net/tun", os.O_RDWR | os.O_NONBLOCK)
            fcntl.ioctl(end, TUNSETIFF, struct.pack("16sH", b"wire", IFF_TUN | IFF_NO_PI))
            found.append(end)

        thread = threading.Thread(target=make)
        thread.start()
        thread.join()
        return found[0]

    def _carry(self):
        waiting, order, due = [], itertools.count(), [0.0, 0.0]
        while not self._ending:
            now = time.monotonic()
            pause = 0.05 if not waiting else max(0.0, min(0.05, waiting[0][0] - now))
            for end in select.select(self._ends, [], [], pause)[0]:
                packet = os.read(end, 65536)
                self.carried += 1
                if self.is_cut or self._chance.random() < self.loss:
                    self.lost += 1
                    continue
                way = self._ends.index(end)
                delay = self.delay + self._chance.uniform(-self.jitter, self.jitter)
                # In order: another order counts as loss to TCP.
                due[way] = max(due[way], time.monotonic() + delay)
                heapq.heappush(waiting, (due[way], next(order), self._ends[1 - way], packet))
            while waiting and waiting[0][0] <= time.monotonic():
                *_, end, packet = heapq.heappop(waiting)
                if not self.is_cut:
                    os.write(end, packet)
