"""Two devices under every kind of command for minutes, quiet and with every core busy.

Run with `make storm`; ORIENTD_STORM_SECONDS and ORIENTD_STORM_SEED say for how long and which.
"""

import contextlib
import math
import os
import random
import threading
import time
from collections import Counter, defaultdict
from concurrent.futures import ThreadPoolExecutor

import grpc
import numpy as np
import pytest
from bare_loop import busy_cores, processes
from command_line import orientd
from storm_rig import DEVICES, Rig, memory_mib, sent, shares_of_limits
from wild import anywhere, wild_motion

import orientd as api
from orientd.client.move_handle import MoveHandle
from orientd.errors import DaemonError, OrientdError, PlanError, RequestError, StateError
from orientd.protocol import control_pb2 as pb
from orientd.protocol.reports import word
from orientd.tolerances import GUARD_TOLERANCE

pytestmark = pytest.mark.storm

SECONDS = float(os.environ.get("ORIENTD_STORM_SECONDS", "600"))
SEED = int(os.environ.get("ORIENTD_STORM_SEED", "1"))

LONGEST = 1.0
"""Longest permitted duration of a call, s, except for plans with a reported time or a deadline."""

MOST_MIB = {"daemon": 90.0, "planner": 160.0, "servo": 30.0, "servo without rings": 20.0}
"""Peak resident memory.  A servo shares its rings with the daemon."""

BURST = 15
REFUSALS = (PlanError, RequestError, StateError)
FAULTS = (pb.EVENT_KIND_FAULT, pb.EVENT_KIND_SERVO_DIED)


def is_deadline(error):
    """Whether a call was refused because its plan was not ready in time."""
    cause = error.__cause__
    is_code = isinstance(cause, grpc.Call) and cause.code() is grpc.StatusCode.DEADLINE_EXCEEDED
    return is_code or "deadline" in str(error)


class Calls:
    """How long every call took, what was refused, and what should not have happened."""

    def __init__(self):
        self.times = defaultdict(list)
        self.refusals = Counter()
        self.broken = Counter()
        self._lock = threading.Lock()

    def make(self, name, work, *arguments, **more):
        """Call *work*; return what it returns, or ``None`` where it is refused for a reason."""
        begun = time.monotonic()
        error, said = None, 0.0
        try:
            answer = work(*arguments, **more)
            if isinstance(answer, MoveHandle):
                said = answer.timing.planning
            elif isinstance(answer, pb.Plan):
                said = answer.planning
            return answer
        except REFUSALS as refusal:
            error, said = refusal, refusal.planning
        except OrientdError as failure:
            error = failure
            if not (isinstance(error, DaemonError) and is_deadline(error)):
                self.fail(f"{name}: {type(error).__name__}: {error}")
        finally:
            self.note(name, time.monotonic() - begun, error, said)
        return None

    def note(self, name, took, error=None, said=0.0):
        """Note a call that took so many seconds, of which it said some, or was refused."""
        with self._lock:
            self.times[name].append(took)
            if error is not None:
                self.refusals[f"{name}: {type(error).__name__}"] += 1
            if took - said > LONGEST and not (error and is_deadline(error)):
                self.broken[f"{name} took longer than {LONGEST:g} s"] += 1

    def fail(self, what):
        with self._lock:
            self.broken[what] += 1


class Pilot:
    """Does whatever comes to mind with one device."""

    def __init__(self, robot, device, calls, seed):
        self.robot, self.device, self.calls = robot, device, calls
        self.chance = random.Random(f"{seed} {device}")
        self.methods = [method.name for method in robot.methods()]

    def fly(self, end):
        """Give one command after the other until *end*, s of the monotonic clock."""
        deeds = {
            self.move: 8, self.queue: 4, self.burst: 1, self.stop: 1, self.halt: 1, self.pause: 2,
            self.change_speed: 2, self.track: 2, self.plan: 2,
        }  # fmt: skip
        while time.monotonic() < end:
            (deed,) = self.chance.choices(list(deeds), list(deeds.values()))
            deed()
            time.sleep(self.chance.choice((0.0, 0.05, 0.3, 1.5)) * self.chance.random())
            self.mend()

    def mend(self):
        """Clear a reported fault, so that the storm continues."""
        report = self.robot.state().devices[self.device]
        if report.fault != pb.FAULT_NONE:
            self.calls.fail(f"fault {word(report, 'fault')}: {report.fault_text}")
            with contextlib.suppress(OrientdError):
                self.robot.reset(self.device)

    def move(self, name="Move", **more):
        keyframes, fields = wild_motion(self.chance, self.methods)
        work = lambda: self.robot.move(keyframes, device=self.device, **more, **fields)  # noqa: E731
        self.calls.make(name, work)

    def plan(self):
        keyframes, fields = wild_motion(self.chance, self.methods)
        self.calls.make("Plan", self.robot.plan, keyframes, device=self.device, **fields)

    def queue(self):
        for _ in range(self.chance.randint(1, 4)):
            blend = self.chance.choice((0.0, 0.02, 0.1))
            self.move("Move, queued", queue=True, blend_tolerance=blend)

    def burst(self):
        """Give many motions, at once or one upon the other."""
        if self.chance.random() < 0.5:
            for _ in range(BURST):
                self.move("Move, in a burst")
            return
        motions = [wild_motion(self.chance, self.methods) for _ in range(BURST)]

        def begin(motion):
            keyframes, fields = motion
            make = self.calls.make
            make("Move, at once", self.robot.move, keyframes, device=self.device, **fields)

        with ThreadPoolExecutor(BURST) as pool:
            list(pool.map(begin, motions))

    def stop(self):
        self.calls.make("Stop", self.robot.stop, self.device)

    def halt(self):
        self.calls.make("Halt", self.robot.halt, self.device)

    def pause(self):
        self.calls.make("Pause", self.robot.pause, self.device)
        time.sleep(self.chance.uniform(0.0, 0.4))
        self.calls.make("Resume", self.robot.resume, self.device)

    def change_speed(self):
        speed = self.chance.choice((1.0, 1.0, self.chance.uniform(0.02, 1.0)))
        self.calls.make("SetSpeed", self.robot.set_speed, speed, self.device)

    def track(self):
        """Have the device follow targets that nothing could follow."""
        tracking = self.calls.make("Track", self.robot.track, device=self.device)
        if tracking is None:
            return
        end = time.monotonic() + self.chance.uniform(0.1, 2.0)
        rest = self.chance.choice((0.002, 0.01, 0.1))
        try:
            while time.monotonic() < end:
                self.aim(tracking)
                time.sleep(rest)
            tracking.close()
        except OrientdError as error:
            # Any other end of the tracking is a reported fault, or a request.
            self.calls.refusals[f"target: {type(error).__name__}"] += 1
            with contextlib.suppress(OrientdError):
                tracking.close()

    def aim(self, tracking):
        w, x, y, z = anywhere(self.chance)
        scale = self.chance.choices((1.0, 1.1, math.nan), (98, 1, 1))[0]
        target = api.Quaternion(w=scale * w, x=x, y=y, z=z)
        more = {}
        if self.chance.random() < 0.5:
            spin = self.chance.choice((0.5, 5.0, 1e3))
            more["angular_velocity"] = [self.chance.gauss(0.0, spin) for _ in range(3)]
        if self.chance.random() < 0.3:
            shift = self.chance.uniform(-0.6, 0.2)
            more["time_ns"] = time.monotonic_ns() + round(shift * 1e9)
        if self.chance.random() < 0.3:
            more["position"] = [self.chance.uniform(-0.2, 0.2) for _ in range(3)]
        if self.chance.random() < 0.2:
            more["time_to_live"] = 10.0 ** self.chance.uniform(-3.0, 0.5)
        tracking.aim(target, **more)


class Watch:
    """Asks how everything is, all the time, and hears what happens."""

    def __init__(self, rig, calls):
        self.rig, self.calls = rig, calls
        self.mib = dict.fromkeys(MOST_MIB, 0.0)
        self.planners = set()
        self._ending = threading.Event()
        self._robot = api.connect(rig.socket, holder="watch")
        self._events = rig.stub.WatchEvents(pb.WatchEventsRequest())
        next(self._events)
        works = (self._ask, self._command, self._weigh, self._listen)
        self._threads = [threading.Thread(target=work, daemon=True) for work in works]

    def __enter__(self):
        for thread in self._threads:
            thread.start()
        return self

    def __exit__(self, *_):
        self._ending.set()
        self._events.cancel()
        for thread in self._threads:
            thread.join()
        self._robot.close()

    def _ask(self):
        while not self._ending.wait(0.05):
            self.calls.make("GetState", self._robot.state)

    def _command(self):
        while not self._ending.wait(5.0):
            # No daemon answers here, so this measures the start of a command on a busy machine.
            begun = time.monotonic()
            orientd("status", "--socket", self.rig.folder / "nowhere")
            middle = time.monotonic()
            done = orientd("status", "--socket", self.rig.socket)
            start, whole = middle - begun, time.monotonic() - middle
            self.calls.note("`orientd status`", max(whole - start, 0.0))
            if done.returncode:
                self.calls.fail(f"`orientd status`: {done.stderr}")

    def _weigh(self):
        while not self._ending.wait(0.5):
            planners = self.rig.planners()
            self.planners |= planners
            servos = [(memory_mib(pid, "RssShmem"), memory_mib(pid)) for pid in self.rig.servos()]
            sizes = {
                "daemon": [memory_mib(self.rig.pid)],
                "planner": [memory_mib(pid) for pid in planners],
                "servo": [most for _, most in servos],
                "servo without rings": [most - rings for rings, most in servos],
            }
            for name, found in sizes.items():
                self.mib[name] = max(self.mib[name], *found, 0.0)

    def _listen(self):
        with contextlib.suppress(grpc.RpcError):
            for response in self._events:
                for event in response.events:
                    if event.kind in FAULTS:
                        self.calls.fail(f"{event.device}: {event.text}")


def check_sent(rig, limits, calls):
    """Return lines that say what was sent, and note what it breaks."""
    lines = []
    for name, path in rig.recordings.items():
        setpoints = sent(path)
        assert np.isfinite(setpoints["q"]).all()
        shares, judge = shares_of_limits(setpoints, limits[name])
        for quantity, share in shares.items():
            if not share <= GUARD_TOLERANCE:
                calls.fail(f"{name}: {quantity} is {share:.6f} of its limit")
        told = ", ".join(f"{quantity} {share:.4f}" for quantity, share in shares.items())
        lines.append(
            f"{name}: {len(setpoints)} setpoints, {judge.rests} stalls; of the limit: {told}"
        )
    return lines


def table(calls, watch):
    """Return what was done and measured, a line each."""
    lines = [f"{'call':20}{'count':>8}{'p50 ms':>9}{'p99 ms':>9}{'max ms':>9}"]
    for name, times in sorted(calls.times.items()):
        p50, p99, largest = (1e3 * np.percentile(times, share) for share in (50, 99, 100))
        lines.append(f"{name:20}{len(times):8}{p50:9.1f}{p99:9.1f}{largest:9.1f}")
    refused = ", ".join(f"{what} {count}" for what, count in sorted(calls.refusals.items()))
    sizes = ", ".join(f"{name} {mib:.1f} MiB" for name, mib in watch.mib.items())
    return [
        *lines, f"refused: {refused}", f"peak resident: {sizes}; {len(watch.planners)} planners",
    ]  # fmt: skip


@pytest.mark.parametrize("company", ["quiet", "every core busy"])
def test_nothing_breaks_under_a_storm_of_commands(tmp_path, company):
    calls = Calls()
    with (
        Rig(tmp_path) as rig,
        api.connect(rig.socket, holder="storm") as robot,
        processes([] if company == "quiet" else busy_cores()),
    ):
        limits = {device.name: device.limits for device in robot.devices()}
        pilots = [Pilot(robot, name, calls, SEED) for name in DEVICES]
        with Watch(rig, calls) as watch, ThreadPoolExecutor(len(pilots)) as pool:
            end = time.monotonic() + SECONDS
            list(pool.map(lambda pilot: pilot.fly(end), pilots))
        robot.halt()
        lines = [*table(calls, watch), *check_sent(rig, limits, calls)]
        print(f"\n{company}, {SECONDS:g} s, seed {SEED}", *lines, sep="\n")
        for name, most in MOST_MIB.items():
            if watch.mib[name] > most:
                calls.fail(f"{name}: {watch.mib[name]:.1f} MiB resident, at most {most:g}")
        broken = "\n".join(f"{count} times: {what}" for what, count in calls.broken.most_common())
        if broken:
            pytest.fail(broken, pytrace=False)
