"""Faults of link, processes, disk and clock, from a seed.

Each fault lasts a while, and the checks of its effects stand next to it: a motion whose daemon or
servo is gone comes to rest, and the faults of :data:`HARMLESS` do not affect the device.
"""

from __future__ import annotations

import errno

AT_REST = 4.0
"""Longest time until a stop is complete, s."""

SLOW = (0.01, 0.2, 2.0)
"""Times that a slow disk takes, s."""

KINDS = (
    "link", "link_delay", "link_loss", "link_reset", "stale", "fault", "write",
    "kill_servo", "stop_servo", "stop_daemon", "kill_daemon", "restart_daemon",
    "disk_full", "disk_slow", "disk_read_only", "wall_clock", "pause", "lateness",
)  # fmt: skip

HARMLESS = ("disk_full", "disk_slow", "disk_read_only", "wall_clock")
"""Faults that must not affect the device."""


class Disk:
    """The disk of the machine.

    Attributes:
        fault: ``full``, ``slow``, ``read only``, or nothing.
    """

    def __init__(self, scheduler):
        self._scheduler, self.fault = scheduler, ""

    def write(self, path=""):
        """Do what a write to a file does, but for the file.

        Raises:
            OSError: the disk takes nothing.
        """
        if self.fault == "full":
            raise OSError(errno.ENOSPC, "no space left on device", str(path))
        if self.fault == "read only":
            raise OSError(errno.EROFS, "read-only file system", str(path))
        if self.fault == "slow":
            self._scheduler.sleep(self._scheduler.random.choice(SLOW))


class Faults:
    """Let one fault after another happen, for as long as the seed says."""

    def __init__(self, system, every):
        self.system, self.random, self.every = system, system.random, every
        self.is_over = False

    def live(self):
        while not self.is_over:
            self.system.scheduler.sleep(self.random.expovariate(1.0 / self.every))
            if self.random.random() < 0.7:
                self.await_motion()
            kind = self.random.choice(KINDS)
            self.system.counts[f"fault: {kind}"] += 1
            if kind in HARMLESS:
                getattr(self, kind)()
                continue
            self.system.trouble = kind
            getattr(self, kind)()
            self.system.trouble, self.system.trouble_ns = "", self.system.scheduler.now_ns

    def await_motion(self):
        """Wait until the device moves, but not for long."""
        for _ in range(100):
            if self.system.is_moving:
                return
            self.system.scheduler.sleep(0.1)

    def last(self, *longest):
        seconds = self.random.choice((0.005, 0.05, 0.3, 1.2, *(longest or (3.0,))))
        self.system.scheduler.sleep(seconds)
        return seconds

    def _of_device(self, fault):
        self.system.device.fault = fault
        self.last()
        self.system.device.fault = ""

    def link(self):
        self._of_device("link")

    def stale(self):
        self._of_device("stale")

    def fault(self):
        self._of_device("fault")

    def write(self):
        self._of_device("write")

    def link_loss(self):
        self._of_device("loss")

    def link_reset(self):
        self._of_device("reset")

    def link_delay(self):
        """Let feedback be late, by less or by more than the shipped timeout."""
        self.system.device.delay_ns = round(self.random.choice((0.005, 0.03, 0.2, 0.6)) * 1e9)
        self.last()
        self.system.device.delay_ns = 0

    def kill_servo(self):
        if self.system.servo is not None:
            self.system.servo.kill()

    def stop_servo(self):
        servo = self.system.servo
        if servo is not None:
            self.system.scheduler.freeze(servo.group)
            self.last()
            self.system.scheduler.thaw(servo.group)

    def stop_daemon(self):
        """Let the daemon stand still: the servo stops by itself."""
        system, daemon = self.system, self.system.daemon
        daemon.was_frozen = True
        system.scheduler.freeze(daemon.group)
        if self.last(*[AT_REST + 1.0] * 8) > AT_REST and system.is_moving:
            system.tell("the device moves though its daemon stands still")
        system.scheduler.thaw(daemon.group)
        system.scheduler.sleep(0.1)
        daemon.was_frozen = False

    def kill_daemon(self):
        """Kill the daemon: the servo stops on the path and ends."""
        system, servo = self.system, self.system.servo
        system.kill_daemon()
        is_early = self.random.random() < 0.5
        if not is_early:
            system.scheduler.sleep(AT_REST)
            if system.is_moving:
                system.tell("the device moves though its daemon was killed")
            if servo is not None and servo.returncode is None:
                system.tell("the servo of a killed daemon has not ended")
        elif servo is not None:
            # Nothing but the link keeps two servos apart; a robot takes one client.
            servo.wait()
        system.start_daemon()

    def restart_daemon(self):
        """Terminate the daemon, and start another."""
        system, daemon = self.system, self.system.daemon
        if not daemon.is_serving:
            return
        daemon.end()
        for _ in range(4000):
            if daemon.has_ended:
                break
            system.scheduler.sleep(0.01)
        else:
            system.tell("the daemon does not end")
        if system.is_moving:
            system.tell("the device moves though its daemon has ended")
        system.start_daemon()

    def _of_disk(self, fault):
        self.system.disk.fault = fault
        self.last(20.0)
        self.system.disk.fault = ""

    def disk_full(self):
        self._of_disk("full")

    def disk_read_only(self):
        self._of_disk("read only")

    def disk_slow(self):
        self._of_disk("slow")

    def wall_clock(self):
        self.system.scheduler.wall_ns += round(self.random.gauss(0.0, 3600.0) * 1e9)

    def pause(self):
        """Let the whole machine stand still, as a virtual machine that is moved."""
        self.system.scheduler.now_ns += round(self.random.choice((0.02, 0.3, 3.0)) * 1e9)

    def lateness(self):
        self.system.lateness = self.random.choice((0.005, 0.05, 0.3))
        self.last(10.0)
        self.system.lateness = 0.0
