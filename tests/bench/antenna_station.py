"""A rotator with its whole system, which `rotctl` asks once a second to follow a satellite.

Every part is real and runs in a process of its own: the emulated bus with its two servos, the
daemon with its planners and its servo process, `orientd serve rotctld`, and `rotctl` of Hamlib.
"""

import contextlib
import math
import os
import pty
import re
import signal
import subprocess
import threading
import time
from dataclasses import dataclass

import numpy as np
from command_line import begin, environment
from harness import run_first
from reference import sky
from reference.pass_search import least_loss

from orientd.client import connect
from orientd.rotation import rotate

PERIOD = 0.1
"""Of the servo's cycles, s: many rotators share a machine."""

BEFORE = 75.0
"""Least time before the rise at which the client points at its place, s."""

TOLERANCE_DEG = 0.5

_AZIMUTH = re.compile(r"(p )?-?[0-9]+\.[0-9]+")
"""Line with which `rotctl` answers ``p``."""


@dataclass
class Rotator:
    """Ranges, degrees, and rates of the axes, degrees a second."""

    azimuth: tuple[float, float]
    elevation: tuple[float, float]
    velocity: float
    acceleration: float = 60.0

    @property
    def longest_turn(self):
        """How long a turn all the way round and the way back to the target take, s."""
        return 1.2 * 360.0 / self.velocity + 10.0

    def settings(self, socket, port):
        """Return the daemon's settings."""
        axes = "".join(
            f"[[devices.antenna.options.axes]]\nid = {k}\nname = '{name}'\nmodel = 'xm430'\n"
            f"limits_deg = {list(limits)}\nvelocity_deg = {self.velocity}\n"
            f"acceleration_deg = {self.acceleration}\n"
            for k, (name, limits) in enumerate(
                (("azimuth", self.azimuth), ("elevation", self.elevation)), 1
            )
        )
        patience = 10.0
        return (
            f'[daemon]\nsocket = "{socket}"\n[devices.antenna]\ndriver = "dynamixel"\n'
            f"rate_hz = {1.0 / PERIOD:g}\nfeedback_timeout = {patience}\n"
            f"stall_timeout = {patience}\nheartbeat_timeout = {patience}\n"
            "[devices.antenna.limits]\nvelocity = 1.5\nacceleration = 8\njerk = 1500\n"
            f'[devices.antenna.options]\nport = "{port}"\norder = "ZY"\n'
            'mount = {w = 0, x = 1, y = 0, z = 0}\noverwrite = ["operating_mode"]\n'
            'allow_slews = true\nturns_file = ""\nmax_losses = 1000\nlatency_ms = 500\n'
            f"watchdog_ms = 0\n{axes}"
        )


@dataclass
class Followed:
    """How a satellite was followed, from its rise until it set.

    Attributes:
        setpoints: time off target of the setpoints, s.
        measured: time off target of the measured directions, s.
        missed: cycles that the servo skipped, because the machine did not run it in time.
        notes: what the server printed.
        times: since the rise, s, shape ``(n,)``.
        errors: of the setpoints at them, degrees.
        joints: commanded axis angles, degrees, shape ``(n, 2)``.
        wanted: azimuth and elevation of the satellite, degrees, shape ``(n, 2)``.
    """

    setpoints: float
    measured: float
    missed: int
    notes: str
    times: np.ndarray
    errors: np.ndarray
    joints: np.ndarray
    wanted: np.ndarray


def directions(azimuth, elevation):
    """Return unit vectors: x to the north, y to the west, z up."""
    azimuth, elevation = np.radians(azimuth), np.radians(elevation)
    level = np.cos(elevation)
    return np.stack([level * np.cos(azimuth), -level * np.sin(azimuth), np.sin(elevation)], -1)


def time_off(times, errors, limit=TOLERANCE_DEG):
    """Return for how long an error that is linear between samples exceeds a limit, s."""
    total = 0.0
    for step, a, b in zip(np.diff(times), errors[:-1] - limit, errors[1:] - limit, strict=True):
        if a > 0.0 and b > 0.0:
            total += step
        elif a > 0.0 or b > 0.0:
            total += step * max(a, b) / abs(a - b)
    return float(total)


class Sky:
    """A satellite as an observer sees it, highest at a time.

    Attributes:
        rise: s since the epoch.
        end: when it sets, s since the epoch.
        elements: its name and its two lines.
    """

    def __init__(self, one, highest):
        self._satellite, lines = sky.at_highest(one, highest)
        self.observer = one.observer
        self._site = sky.site(*one.observer)
        fine = highest + np.arange(-1000.0, 1000.0, 0.1)
        up = self.look(fine)[1] > 0.0
        middle = len(fine) // 2
        self.rise = float(fine[middle - np.argmin(up[middle::-1]) + 1])
        self.end = float(fine[middle + np.argmin(up[middle:]) - 1])
        self.elements = "\n".join(["SATELLITE", *lines, ""])

    def look(self, when):
        """Return azimuth and elevation, degrees."""
        satellite = self._satellite
        day = np.asarray(when) / 86400.0 + 2440587.5
        minutes = (day - satellite.jdsatepoch - satellite.jdsatepochF) * 1440.0
        return sky.look(satellite, minutes, self._site)


class Station:
    """A rotator and all that drives it; a context manager."""

    def __init__(self, folder, rotator):
        self.folder, self.rotator = folder, rotator
        folder.mkdir()
        self.socket = folder / "socket"
        self._running = []

    def __enter__(self):
        bus = self.folder / "bus"
        arguments = ("sim", "dynamixel", "--link", bus, "--servos", "1:xm430,2:xm430")
        emulator, _ = self._started(*arguments)
        run_first(emulator.pid)
        config = self.folder / "config.toml"
        config.write_text(self.rotator.settings(self.socket, bus))
        self._started("run", "--config", config)
        return self

    def __exit__(self, *_):
        for process in reversed(self._running):
            process.send_signal(signal.SIGINT)
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.communicate(timeout=60.0)
            if process.poll() is None:
                process.kill()
                process.communicate()
        self._running = []

    def _started(self, *arguments):
        """Start a command, and return it and its line when it is ready."""
        state = self.folder / "state"
        process = begin(*arguments, env=environment(XDG_STATE_HOME=str(state)))
        self._running.append(process)
        line = process.stdout.readline()
        assert line.startswith("ready") or "ready at" in line, (line, process.stderr.read())
        return process, line

    def follow(self, one, has_elements):
        """Follow a pass from before its rise until it sets, as `rotctl` asks for it.

        Args:
            one: the pass.
            has_elements: whether the server knows the orbital elements.
        """
        above = Sky(one, time.time())
        before = max(BEFORE, self.rotator.longest_turn)
        above = Sky(one, time.time() + before + 15.0 + time.time() - above.rise)
        (west, east), (low, high) = self.rotator.azimuth, self.rotator.elevation
        arguments = ["--port", 0, "--socket", self.socket, "--azimuth", f"{west:g}:{east:g}",
                     "--elevation", f"{low:g}:{high:g}"]  # fmt: skip
        if has_elements:
            elements = self.folder / "elements.tle"
            elements.write_text(above.elements)
            latitude, longitude = above.observer
            arguments += ["--tle", elements, "--observer", f"{latitude},{longitude}"]
        server, line = self._started("serve", "rotctld", *arguments)
        port = line.split()[2].rpartition(":")[2]
        cycles = []
        with connect(self.socket) as robot:
            watching = threading.Thread(target=_collect, args=(robot, above.end, cycles))
            watching.start()
            self._ask(port, above)
            watching.join()
        server.send_signal(signal.SIGINT)
        notes = "".join(server.communicate(timeout=60.0))
        return _judged(above, cycles, notes)

    def _ask(self, port, above):
        """Send a position and ask for one, once a second, and wait for both answers.

        A program that is late leaves seconds out, as gpredict does.
        """
        west = self.rotator.azimuth[0]
        ours, its = pty.openpty()  # rotctl answers a terminal line by line
        client = subprocess.Popen(
            ["rotctl", "-m", "2", "-r", f"127.0.0.1:{port}", "-"],
            stdin=subprocess.PIPE, stdout=its, stderr=its, text=True,
        )  # fmt: skip
        os.close(its)
        begun = time.time()
        with open(ours, errors="replace") as answers:  # noqa: PTH123 - a descriptor
            while (now := time.time()) < above.end:
                azimuth, elevation = (float(x[0]) for x in above.look([max(now, above.rise)]))
                # Programs know the range of the azimuth, and send it in the first turn.
                azimuth = west + (azimuth - west) % 360.0
                client.stdin.write(f"P {azimuth:.2f} {max(elevation, 0.0):.2f}\np\n")
                client.stdin.flush()
                for line in answers:
                    if _AZIMUTH.fullmatch(line.strip()):
                        answers.readline()  # the elevation
                        break
                    if "get_pos: error" in line:
                        break
                time.sleep(1.0 - (time.time() - begun) % 1.0)
            client.stdin.close()
            client.wait(timeout=60.0)


def _collect(robot, end, cycles):
    offset = time.time() - time.monotonic()
    for batch in robot.watch("antenna", rate_hz=0.5):
        cycles += [(one, 1e-9 * one.deadline_ns + offset) for one in batch]
        if time.time() > end + 3.0:
            return


def _judged(above, cycles, notes):
    wall = np.array([at for _, at in cycles])
    records = [one for one, _ in cycles]
    x_axis = np.array([1.0, 0.0, 0.0])

    def errors(times, q):
        aim, made = directions(*above.look(times)), rotate(q, x_axis)
        return np.degrees(2.0 * np.arcsin(np.minimum(1.0, np.linalg.norm(aim - made, axis=1) / 2)))

    # A setpoint is for the end of its cycle.
    due = wall + PERIOD
    during = (due >= above.rise) & (due <= above.end)
    off = errors(due[during], np.array([one.q for one in records])[during])
    offset = wall - 1e-9 * np.array([one.deadline_ns for one in records])
    seen = 1e-9 * np.array([one.feedback_time_ns for one in records]) + offset
    fresh = np.unique(seen, return_index=True)[1]
    fresh = fresh[(seen[fresh] >= above.rise) & (seen[fresh] <= above.end)]
    off_measured = errors(seen[fresh], np.array([one.feedback_q for one in records])[fresh])
    kept = [one for one, is_in in zip(records, during, strict=True) if is_in]
    return Followed(
        setpoints=time_off(due[during], off),
        measured=time_off(seen[fresh], off_measured),
        missed=kept[-1].missed - kept[0].missed,
        notes=notes,
        times=due[during] - above.rise,
        errors=off,
        joints=np.degrees([one.sent_joints for one in kept]),
        wanted=np.stack(above.look(due[during]), axis=-1),
    )


def least_time_off(followed, rotator):
    """Return the least time off target that a fine search finds for the same pass, s."""
    times = np.arange(followed.times[0], followed.times[-1], 0.05)
    azimuth, elevation = np.radians(followed.wanted).T
    return least_loss(
        times, np.interp(times, followed.times, np.unwrap(azimuth)),
        np.interp(times, followed.times, elevation), turns=np.radians(rotator.azimuth),
        inner=np.radians(rotator.elevation), velocity=math.radians(rotator.velocity),
        acceleration=math.radians(rotator.acceleration), tolerance=math.radians(TOLERANCE_DEG),
    )  # fmt: skip
