"""Clients of the system, and an operator who resets the device.

The seed makes every choice.  Each check stands next to its cause.  A client expects an answer or an
error of orientd's, and it expects that a stop stops.
"""

from __future__ import annotations

import contextlib
import math
from functools import partial
from types import SimpleNamespace

from faults import AT_REST, Faults
from motions import motion_of

from orientd.config import Role
from orientd.daemon.access.identity import Caller, Identity
from orientd.errors import OrientdError
from orientd.protocol import control_pb2 as pb
from orientd.stream.records import ServoState

PATIENCE = 75.0
"""Longest time for the answer to a command, s: a driver may take 60."""

_DRIVEN = (ServoState.STREAMING, ServoState.TRACKING, ServoState.STOPPING)


class GoneError(Exception):
    """No daemon runs."""


class Client:
    """A client with an identity, which sends one request after another."""

    def __init__(self, system, name, user):
        self.system, self.name, self.random = system, name, system.random
        identity = Identity(f"user:{user}", user, Role.OPERATOR)
        self.caller = Caller(SimpleNamespace(), name, identity)
        self.token = ""
        self.moves = []
        self._planned = ""

    # Asking

    def wait_for(self, what, patience=PATIENCE):
        """Return what a coroutine of the service returns, or raise what it does.

        Raises:
            GoneError: the daemon ends first, or there is none.
        """
        daemon, scheduler = self.system.daemon, self.system.scheduler
        future, task = self.begin(what), scheduler.current()
        future.add_done_callback(lambda _: scheduler.wake(task))
        daemon.callers.append(task)
        until_ns = scheduler.now_ns + round(patience * 1e9)
        while not future.done():
            scheduler.wait(until_ns)
            if daemon is not self.system.daemon or not daemon.is_serving:
                raise GoneError
            if scheduler.now_ns >= until_ns and not future.done():
                if not daemon.was_frozen:
                    self.system.tell(f"{self.name}: no answer within {patience:g} s")
                raise GoneError
        daemon.callers.remove(task)
        return future.result()

    def begin(self, what):
        daemon = self.system.daemon
        if daemon is None or not daemon.is_serving:
            raise GoneError
        return daemon.call(what(daemon.service))

    def ask(self, method, request):
        answer = self.wait_for(lambda service: getattr(service, method)(request, self.caller))
        self.system.note(self.name, method, answer)
        return answer

    def live(self):
        """Send one request after another, and now and then let another client continue."""
        kinds = (
            *["move"] * 6, *["queue"] * 3, *["replace"] * 4, "track", "stop", "stop_one", "halt",
            "pause", "resume", "set_speed", "look", "plan", "run_plan", "leave", "lease",
            "release", "disable", "enable", "timed",
        )  # fmt: skip
        while True:
            kind = self.random.choice(kinds)
            self.system.counts[kind] += 1
            self.attempt(getattr(self, kind))
            self.system.scheduler.sleep(self.random.expovariate(1.0 / 1.5))
            if self.random.random() < 0.1:
                if self.token:
                    self.attempt(self.release)
                self.system.scheduler.sleep(self.random.expovariate(0.1))

    def keep(self, lapses=0.05):
        """Renew the lease in time, or too late in a share of *lapses*."""
        while True:
            self.system.scheduler.sleep(5.0 if self.random.random() < lapses else 0.5)
            if self.token:
                self.attempt(self.renew)

    def attempt(self, act):
        """Send a request that the daemon may refuse; return the result."""
        try:
            return act()
        except GoneError:
            self.token, self.moves = "", []
        except OrientdError as error:
            self.refused(error)
        except Exception as error:  # noqa: BLE001 - whatever else it is, it must not be
            self.system.tell(f"{self.name}: {act.__name__}: {error!r}")
        return None

    def refused(self, error):
        self.system.note(self.name, repr(error))
        self.system.counts[f"refused: {type(error).__name__}"] += 1

    # Moving

    def motion(self):
        random = self.random
        keyframes = [self._keyframe() for _ in range(random.choice((1, 1, 1, 2, 4)))]
        fields = {}
        if random.random() < 0.3:
            fields.update(end_velocity=self._numbers(0.4), velocity_frame="body")
        if random.random() < 0.4:
            fields["limits"] = {"velocity": random.choice((0.05, 0.1, 0.2, 1.0, 2.5))}
        return motion_of(*keyframes, **fields, approach=True)

    def _keyframe(self):
        keyframe = {"rotation_vector": self._numbers(random_size(self.random))}
        if self.random.random() < 0.3:
            keyframe["position"] = self._numbers(0.3)
        return keyframe

    def _numbers(self, size):
        return [self.random.gauss(0.0, size) for _ in range(3)]

    def _vector(self, size):
        x, y, z = self._numbers(size)
        return pb.Vector3(x=x, y=y, z=z)

    def move(self, **options):
        """Run a motion, and read its progress until its end or until this client leaves."""
        request = pb.MoveRequest(device="arm", lease_token=self.token, **options)
        request.progress_rate_hz = self.random.choice((1.0, 20.0))
        if not request.motion_id:
            request.motion = self.motion()
        if not self.token:
            request.holder, request.beside = self.name, self.random.random() < 0.5
        if self.random.random() < 0.2:
            request.on_target.CopyFrom(
                pb.OnTarget(tolerance=0.01, rate=0.05, settle_time=0.1, timeout=2.0)
            )
        self.begin_move(request)

    def begin_move(self, request):
        answers = []

        async def listen(service):
            async with contextlib.aclosing(service.Move(request, self.caller)) as stream:
                async for answer in stream:
                    if not isinstance(answer, pb.MoveResponse):
                        answer = pb.MoveResponse.FromString(answer.content)
                    answers.append(answer)
                    self.system.note(self.name, answer)
                    if answer.HasField("started") and answer.started.lease.token:
                        self.token = answer.started.lease.token

        future = self.begin(listen)
        self.moves = [one for one in self.moves if not one.done()] + [future]
        future.add_done_callback(lambda one: self._look_at(one, answers))

    def _look_at(self, future, answers):
        """Check the end of a motion, also if its client has left."""
        if future.cancelled():
            return
        error = future.exception()
        if error is None:
            summary = answers[-1].summary if answers else pb.MoveSummary()
            self.system.counts[pb.Outcome.Name(summary.outcome).lower()] += 1
            if not summary.outcome:
                self.system.tell(f"{self.name}: a motion without an outcome: {summary}")
        elif isinstance(error, OrientdError):
            self.refused(error)
        else:
            self.system.tell(f"{self.name}: move: {error!r}")

    def queue(self):
        self.move(queue=True, blend_tolerance=self.random.choice((0.0, 0.05, 0.3)))

    def replace(self):
        for _ in range(self.random.choice((1, 1, 2, 4))):
            self.move()
            self.system.scheduler.sleep(self.random.choice((0.0, 0.01, 0.1, 0.5)))

    def timed(self):
        ahead = self.random.choice((0.001, 0.1, 1.0))
        self.move(start_ns=self.system.scheduler.now_ns + round(ahead * 1e9))

    def leave(self):
        """Leave a motion, as a killed program does."""
        if self.moves:
            self.moves.pop(self.random.randrange(len(self.moves))).cancel()

    def plan(self):
        request = pb.PlanRequest(device="arm", motion=self.motion())
        answer = pb.PlanResponse.FromString(self.ask("Plan", request))
        self._planned = answer.plan.motion_id

    def run_plan(self):
        if self._planned:
            self.move(motion_id=self._planned)

    def track(self):
        """Follow targets, some of which are late, wild, or none."""
        random, scheduler = self.random, self.system.scheduler
        self.lease()
        count, pause = random.randrange(1, 60), random.choice((0.01, 0.05, 0.2))
        swing, rate, start = self._vector(0.3), random.uniform(0.2, 3.0), scheduler.now_ns

        async def targets():
            from asyncio import sleep

            yield pb.TrackRequest(start=pb.TrackStart(device="arm", lease_token=self.token))
            for _ in range(count):
                if random.random() < 0.05:
                    await sleep(random.expovariate(1.0))
                angle = math.sin(rate * (scheduler.now_ns - start) * 1e-9)
                half = 0.5 * angle * math.hypot(swing.x, swing.y, swing.z)
                if random.random() < 0.05:
                    half += random.uniform(-2.0, 2.0)
                target = pb.TrackTarget(time_to_live=random.choice((0.1, 0.5)))
                target.orientation.w, target.orientation.z = math.cos(half), math.sin(half)
                if random.random() < 0.02:
                    target.orientation.w = random.choice((math.nan, 3.0))
                yield pb.TrackRequest(target=target)
                await sleep(pause)

        async def follow(service):
            async with contextlib.aclosing(service.Track(targets(), self.caller)) as reports:
                async for report in reports:
                    self.system.note(self.name, report)

        self.wait_for(follow, patience=PATIENCE + 120.0)

    # Commands

    def commanded(self, method, kind, **fields):
        self.lease()
        self.ask(method, kind(device="arm", lease_token=self.token, **fields))

    def pause(self):
        self.commanded("Pause", pb.CommandRequest)
        self.system.scheduler.sleep(self.random.expovariate(1.0))
        self.attempt(self.resume)

    def resume(self):
        self.commanded("Resume", pb.CommandRequest)

    def set_speed(self):
        speed = self.random.choice((0.1, 0.5, 0.9, 1.0, 1.0, 1.5))
        self.commanded("SetSpeed", pb.SetSpeedRequest, speed=speed)

    def disable(self):
        self.commanded("Disable", pb.DisableRequest, by_hand=self.random.random() < 0.3)

    def enable(self):
        self.commanded("Enable", pb.CommandRequest)

    def look(self):
        self.ask("GetState", pb.GetStateRequest())

    def stop(self):
        self._stop("Stop", pb.StopRequest(), self._present())

    def stop_one(self):
        """Stop the motion that the device runs; one that begins meanwhile may continue."""
        present = self._present()
        self._stop("Stop", pb.StopRequest(device="arm", motion_number=present[1]), present)

    def halt(self):
        self._stop("Halt", pb.StopRequest(), self._present())

    def _present(self):
        """Return the state of the device, and its motion."""
        daemon = self.system.daemon

        async def look(_service):
            shown = daemon.devices.device("arm").snapshot()
            return (None, 0) if shown.cycle is None else (shown.state, shown.cycle.motion)

        return self.wait_for(look)

    def _stop(self, method, request, before):
        """Stop, and check that the device is at rest soon, unless the machine stands still.

        *before* is what :meth:`_present` returned: the request ends that motion.
        """
        state, motion = before
        self.ask(method, request)
        self.system.scheduler.sleep(AT_REST)
        if not self.system.is_calm:
            return
        now = self._present()
        if state in _DRIVEN and now[0] in _DRIVEN and now[1] == motion:
            self.system.tell(f"{method}: motion {motion} still moves after {AT_REST:g} s: {now}")

    # Leases

    def lease(self):
        if not self.token:
            request = pb.AcquireLeaseRequest(holder=self.name, devices=["arm"])
            request.beside = self.random.random() < 0.5
            self.token = self.ask("AcquireLease", request).lease.token

    def renew(self):
        try:
            self.ask("RenewLease", pb.RenewLeaseRequest(token=self.token))
        except OrientdError:
            self.token = ""
            raise

    def release(self):
        """Release the lease, if there is one, or try to."""
        token, self.token = self.token, ""
        self.ask("ReleaseLease", pb.ReleaseLeaseRequest(token=token))

    def seize(self):
        request = pb.SeizeLeaseRequest(holder=self.name, devices=["arm"], reason="to mend it")
        self.token = self.ask("SeizeLease", request).lease.token


def random_size(random):
    return random.choice((1e-6, 0.1, 0.5, 1.5, 3.0))


class Mender(Client):
    """Resets a device in a fault, as an operator would."""

    def live(self):
        while True:
            self.system.scheduler.sleep(self.random.uniform(1.0, 4.0))
            self.attempt(self.mend)

    def mend(self):
        state, _ = self._present()
        if state in (None, ServoState.FAULT, ServoState.IDLE):
            self.system.counts["mended"] += 1
            self.seize()
            method = ("Enable", pb.CommandRequest) if state is ServoState.IDLE else None
            try:
                self.commanded(*(method or ("Reset", pb.CommandRequest)))
            finally:
                self.attempt(self.release)

    def audit(self):
        """Check that the device does not move for long without a holder of the lease."""
        lost = {}
        while True:
            self.system.scheduler.sleep(0.5)
            left = self.attempt(self._without_lease) or set()
            now_ns, before = self.system.scheduler.now_ns, lost
            lost = {number: before.get(number, now_ns) for number in left}
            for number, since_ns in lost.items():
                if now_ns - since_ns > 2e9 and self.system.is_calm:
                    self.system.tell(f"motion {number} runs though its lease is lost")

    def _without_lease(self):
        daemon = self.system.daemon

        async def look(_service):
            held = {lease.token for lease in daemon.devices.leases.held()}
            device = daemon.devices.device("arm")
            lost = [run for run in device.unfinished() if run.begun_ns and run.token not in held]
            # One that has been told to end may wait behind another, whose lease is held.
            led_by = device.snapshot().motion_number
            return {run.number for run in lost if run.number == led_by or not run.reason}

        return self.wait_for(look)

    def see_to_the_end(self):
        """Reset the device, move once more, and terminate the daemon."""
        system = self.system
        for _ in range(20):
            system.scheduler.sleep(2.0)
            self.attempt(self.mend)
            if self._present()[0] is ServoState.HOLDING:
                break
        else:
            system.tell(f"the device cannot be mended: {self._present()}")
        system.scheduler.sleep(1.0)  # until the device's thread has heard of the rest
        daemon = system.daemon
        device = daemon.devices.device("arm")
        left = [run.number for run in device.unfinished()]
        if left:
            system.tell(f"the motions {left} have no end")
        self.token, before = "", system.counts["outcome_done"]
        self.seize()
        self.move_home()
        system.scheduler.sleep(1.0)
        self.commanded("SetSpeed", pb.SetSpeedRequest, speed=1.0)
        system.scheduler.sleep(AT_REST + 10.0)
        if system.counts["outcome_done"] != before + 1:
            system.tell("the device does not move any more")
        servo = system.servo
        daemon.end()
        system.scheduler.sleep(AT_REST)
        if not daemon.has_ended or servo.returncode != 0:
            system.tell(f"no orderly end: {daemon.has_ended}, {servo.returncode}")

    def move_home(self):
        keyframe = {"quaternion": {"w": 1, "x": 0, "y": 0, "z": 0}, "position": [0, 0, 0]}
        motion = motion_of(keyframe, approach=True)
        self.begin_move(pb.MoveRequest(device="arm", lease_token=self.token, motion=motion))
        self.system.scheduler.spawn(partial(self.keep, lapses=0.0), "keep")


def play(system, seconds, *, every=10.0):
    """Let everybody do what they do for a while, then see that nothing is left of it.

    Args:
        system: see :func:`emulated_system.emulated`.
        seconds: how long trouble lasts.
        every: mean time from one trouble to the next, s.
    """
    scheduler = system.scheduler
    scheduler.preemption = system.random.choice((0.0, 0.01, 0.1))
    system.start_daemon()
    system.run(1.0)
    crowd = [Client(system, "ana", "ana"), Client(system, "tool", "ana")]
    crowd.append(Client(system, "ben", "ben"))
    for client in crowd:
        scheduler.spawn(client.live, client.name, "crowd")
        scheduler.spawn(client.keep, client.name, "crowd")
    mender = Mender(system, "op", "op")
    scheduler.spawn(mender.live, "op", "crowd")
    scheduler.spawn(mender.audit, "audit", "crowd")
    faults = Faults(system, every)
    task = scheduler.spawn(faults.live, "faults", "faults")
    system.run(seconds)
    faults.is_over = True
    while not task.is_over:
        system.run(1.0)
    scheduler.kill("crowd")
    task = scheduler.spawn(mender.see_to_the_end, "end", "end")
    for _ in range(round(4.0 * PATIENCE)):
        system.run(1.0)
        if task.is_over:
            break
    else:
        system.tell("it does not come to an end")
    scheduler.kill(system.daemon.group)
