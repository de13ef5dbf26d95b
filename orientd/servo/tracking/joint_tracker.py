"""Follow targets with a device's axes, with a checked stop in hand.

In every cycle the tracker solves for the reference's joints, on the branch next to the last ones.
All joints together take one jerk-limited step towards them (``kernels/c/law.h``).  The tracker
sends a step only if the stop after it breaks no limit: of an axis, its range, the tool, a keep-out
cone, or the distance to a singularity.  It rolls that stop out cycle by cycle, with the differences
that the guard computes (``kernels/c/chain.h``), and keeps it in hand.  If no part of a step has
such a stop, it sends the next setpoint of the stop in hand.  So there always is a checked
continuation.

A checked stop is valid for one set of limits.  Limits change when following begins.  The motion at
that time may have no stop inside the new limits.  Then the arm stops at once, inside the wider ones
of old and new.  The new limits hold from the first cycle in which a stop keeps them.  If a path has
no stop inside the wider ones either, following does not begin yet.

While the joints catch up with a target, the tool leaves its straight line
(:mod:`orientd.servo.tracking.straight_line`).  With a tolerance for that, the tracker sends no step
whose stop would end beyond it.
"""

from __future__ import annotations

from array import array
from math import ceil, dist, inf, nan

from orientd import kernels
from orientd.driver import ZERO, Joints, Quaternion, Vector3
from orientd.errors import NotYetError
from orientd.floats import difference, dot, exp, multiply, norm, normalize, plus
from orientd.mechanism.chain import axis_rows
from orientd.mechanism.following import USABLE
from orientd.mechanism.mechanism import Mechanism, Rows
from orientd.servo.guard import Guard
from orientd.servo.keep_out_cones import KeepOutCones, Room
from orientd.servo.tracking.detour import Detour
from orientd.servo.tracking.forecast import JUMP
from orientd.servo.tracking.guidance import Guidance
from orientd.servo.tracking.law import FULL, NO_LIMITS, Need, gains_of
from orientd.servo.tracking.preview import Place, PreviewState
from orientd.servo.tracking.reference import ReferenceState, Target
from orientd.servo.tracking.stop_filter import RESERVE
from orientd.servo.tracking.straight_line import StraightLine
from orientd.stream.records import ServoLimits

TOOL_LIMITS = 15
"""Numbers of a motion's limits that the kernels know."""

LONGEST_STOP = 1000
"""Most cycles of a stop: the speed stays below that from which it takes longer."""

PARTS = (1.0, 0.5, 0.2)
"""Parts of the way from the stop in hand to the wanted step that are tried in turn."""

CAUTION = 0.9
"""Share of the tool's limits to aim at; the check is against all of them."""

RANGE_MARGIN = 0.02
"""Angle to the end of an axis' range that is kept, rad: a device lags behind its setpoints."""

PROBE = 1e-3
"""Size of the step that shows where the joints turn on a way, rad or m."""

HARDEST = 1e9
"""Acceleration of an axis that knows no limit, rad/s^2."""

LOOK = 0.04
"""Turn of a joint between two looks at singularities on the way to a goal, rad."""

STILL = 1e-8
"""Speed of a device that stands, rad/s or m/s."""

SAME_POSE = 1e-9
"""Largest difference of equal poses, rad or m."""

_REFUSED = {
    1: "{axis} is at the end of its range, {value:.4g} rad",
    10: "a stop would enter a keep-out cone",
}
"""Messages about stops, by the kinds of ``kernels/c/chain.h`` that an operator can change."""

_NO_CONES = Rows(1, 7, (0.0, 0.0, 1.0, 0.0, 0.0, 1.0, -4.0))
"""A cone that nothing is inside of."""


class JointTracker:
    """One setpoint of the joints a cycle.

    Attributes:
        limits: the limits in force.
        hindrance: why the axes cannot come closer to the targets; empty if they can.
        is_at_rest: whether nothing turns and no target lives or waits.
        line: how far the tool leaves its straight line.
    """

    def __init__(
        self,
        mechanism: Mechanism,
        chain: array[float],
        guard: Guard,
        guidance: Guidance,
        cones: KeepOutCones | None = None,
        *,
        takes_joints: bool = False,
    ) -> None:
        """Create it for a device that *takes_joints*, or the poses that its joints make.

        Args:
            mechanism: kinematics and limits of the axes.
            chain: the same in numbers, see :func:`~orientd.mechanism.chain.chain_of`.
            guard: the last written setpoints.
            guidance: what to follow.
            cones: keep-out cones of the device.
        """
        self._mechanism, self._chain = mechanism, chain
        self._guard, self._guidance, self._cones = guard, guidance, cones
        self._takes_joints = takes_joints
        self._period = h = guard.period
        self._axes = axis_rows(mechanism, USABLE, RANGE_MARGIN)
        count = len(mechanism.axes)
        self._stop, self._trial = Rows(LONGEST_STOP, count), Rows(LONGEST_STOP, count)
        self._at = self._end = 0
        self._reserves: Rows | None = None
        self._accelerations, self._taken = array("d", bytes(8 * count)), array("d", bytes(24))
        self._goal = array("d", bytes(8 * count))
        self._strain = array("d", bytes(32))
        self._need = Need(h)
        slowest = min(HARDEST, *(axis.acceleration for axis in mechanism.axes))
        self._rest = gains_of(slowest, slowest / h, h)
        self._detour = None if cones is None else Detour(cones, h)
        self._room = None if cones is None else Room(cones)
        self.line = StraightLine()
        self._put_in_force(NO_LIMITS)
        self._asked = self.limits
        self.hindrance, self.is_at_rest = "", True

    def begin(
        self, servo_limits: ServoLimits, before: ServoLimits, joints: Joints, *, continues: bool
    ) -> None:
        """Begin from the last written setpoint, moving or at rest.

        Args:
            servo_limits: to keep from the first cycle on in which a stop keeps them.
            before: limits of the motion so far.
            joints: close to the axes, rad.
            continues: whether the last setpoint is from here too, so that its stop is in hand.

        Raises:
            NotYetError: no stop that begins now keeps every limit.
        """
        in_force, self.hindrance = self.limits, ""
        if not continues:
            self._replay(joints)
        self._look_at_guard()
        self._put_in_force(servo_limits)
        if not self._begins_to_stop():
            wider = map(max, servo_limits.floats(), before.floats())
            self._put_in_force(ServoLimits.from_floats(tuple(wider)))
            if not (continues or self._begins_to_stop()):
                self._put_in_force(in_force)
                reason = self._reason() or "the axes are at their limits"
                raise NotYetError(f"no stop from here keeps every limit: {reason}")
        guard = self._guard
        self._asked = servo_limits
        self._goal[:] = array("d", guard.joints)
        self._pose = guard.q, guard.position
        self._anchor: Vector3 | None = None
        self.is_at_rest = not self._moves()
        self._need.forget()
        self.line.largest = 0.0
        self.forget()

    def forget(self) -> None:
        """Forget on which side of a cone the way led."""
        if self._detour is not None:
            self._detour.forget()
        if self._room is not None:
            self._room.forget()

    @property
    def held(self) -> int:
        """Place of the keep-out cone that holds the target at its edge; -1 for none."""
        return -1 if self._detour is None else self._detour.held

    def rest(self) -> None:
        """Continue from rest at the last written setpoint."""
        self._stop[0] = self._guard.joints
        self._at, self._end = 0, 1
        self._need.forget()
        self.forget()

    def step(self, now_ns: int, *, is_stopping: bool) -> tuple[Quaternion, Vector3, Joints]:
        """Return the setpoint due at *now_ns*: orientation, position in m, and joints in rad."""
        found = None
        self._look_at_guard()
        if self.limits is not self._asked:
            self._narrow()
        elif not is_stopping:
            found = self._guidance.look(now_ns, self)
        if found is None:
            self.is_at_rest = not (self._moves() or self._guidance.awaits)
            self.line.clear()
        else:
            self.is_at_rest = False
            self._advance(found)
        self.line.note((self._guard.q, self._guard.position))
        joints = self._stop[self._at]
        self._at = min(self._at + 1, self._end - 1)
        return (*self._mechanism.forward(joints), joints)

    def moving(self) -> tuple[Quaternion, float]:
        """Return the orientation of the last setpoint, and its angular speed, rad/s."""
        return self._guard.q, norm(self._guard.omega)

    def must_brake(self, target: Target, left: float) -> bool:
        """Return whether a stop that begins later would pass the end *target*, *left* s before."""
        guard, h = self._guard, self._period
        q, position = self._end_of_stop()
        ways = [(difference(guard.q, target.q), guard.omega, difference(guard.q, q))]
        if target.position is not None:
            way, stop = (plus(each, guard.position, -1.0) for each in (target.position, position))
            ways.append((way, guard.velocity, stop))
        for way, rate, stop in ways:
            speed = norm(rate)
            # The next setpoint continues to move for two cycles.
            length = norm(stop) + 2.0 * h * speed
            if speed > STILL and speed * left <= 2.0 * length and dot(way, rate) <= length * speed:
                return True
        return False

    def _moves(self) -> bool:
        guard = self._guard
        return any(guard.joint_rates) or any(guard.joint_changes)

    def _replay(self, near: Joints) -> None:
        """Have the guard know joints and poses of the last setpoints, of which one were written.

        *near* are close to the joints.
        """
        guard, h = self._guard, self._period
        rows: list[tuple[Quaternion, Vector3, Joints]] = []
        if self._takes_joints:
            joints, rates = guard.joints, guard.joint_rates
            for _ in range(3):
                rows.append((*self._mechanism.forward(joints), joints))
                joints = tuple([x - h * v for x, v in zip(joints, rates, strict=True)])
                rates = tuple([v - h * a for v, a in zip(rates, guard.joint_changes, strict=True)])
        else:
            q, position, omega, velocity = guard.q, guard.position, guard.omega, guard.velocity
            for _ in range(3):
                if rows and (q, position) == rows[-1][:2]:
                    rows.append(rows[-1])
                    continue
                found = self._mechanism.nearest(q, position, near)
                if found is None and self._agrees(near, q, position):
                    found = near
                if found is None:
                    raise NotYetError("the device does not reach where it was sent")
                rows.append((q, position, found))
                near = found
                q = multiply(q, exp(plus(ZERO, omega, -h)))
                position = plus(position, velocity, -h)
                omega = plus(omega, guard.alpha, -h)
                velocity = plus(velocity, guard.acceleration, -h)
        guard.anchor(*rows[2])
        guard.take(*rows[1])
        guard.take(*rows[0])

    def _agrees(self, joints: Joints, q: Quaternion, position: Vector3) -> bool:
        """Return whether the pose of *joints* is this one.

        By rounding, a straight arm may not reach the pose that its own joints make.
        """
        q_of_joints, at = self._mechanism.forward(joints)
        return max(norm(difference(q_of_joints, q)), dist(at, position)) <= SAME_POSE

    # The stop in hand

    def begin_to_stop(self, servo_limits: ServoLimits, joints: Joints) -> bool:
        """Take a stop in hand that begins at the last written setpoint, at once.

        It keeps out of the cones if any stop does.

        Args:
            servo_limits: of the motion.
            joints: close to the axes, rad.

        Returns:
            Whether there is one that keeps the limits of axes and tool.
        """
        try:
            self._replay(joints)
        except NotYetError:
            return False
        self._look_at_guard()
        self._put_in_force(servo_limits)
        self._asked = self.limits
        if self._begins_to_stop():
            return True
        self._cone_rows = _NO_CONES
        return self._begins_to_stop()

    def _begins_to_stop(self) -> bool:
        """Take a stop in hand that begins at once; return whether one keeps the limits."""
        self.line.clear()
        self._accelerations[0] = nan
        return any(self._rolls_out(share) for share in (CAUTION, 1.0))

    def _narrow(self) -> None:
        """Put the asked limits in force if a stop that begins now keeps them."""
        wide = self.limits
        self._put_in_force(self._asked)
        if not self._begins_to_stop():
            self._put_in_force(wide)

    def _put_in_force(self, limits: ServoLimits) -> None:
        self.limits = limits
        self._tool_limits = array("d", limits.floats()[:TOOL_LIMITS])

    def _look_at_guard(self) -> None:
        """Note the state from which the next setpoint starts."""
        guard = self._guard
        numbers = (*guard.joints, *guard.joint_rates, *guard.joint_changes)
        self._joints = Rows(3, len(guard.joints), numbers)
        self._differences = array("d", (*guard.omega, *guard.alpha, *guard.velocity))
        self._now = self._mechanism.reserve(guard.joints)
        cones = self._cones
        # Stops keep out of the cones; one that is nowhere stands for none.
        self._cone_rows = _NO_CONES if cones is None else cones.rows(guard.q, RESERVE)

    def _rolls_out(self, share: float = CAUTION) -> bool:
        """Take the stop after a step in hand if it keeps every limit.

        The step has the accelerations at hand; without numbers the stop begins at once.
        """
        trial = self._trial
        drift = 0.0 if self._cones is None else self._cones.rate
        count = kernels.roll_stop(
            self._chain,
            self._axes.view,
            self._tool_limits,
            self._period,
            self._joints.view,
            self._differences,
            self._cone_rows.view,
            share,
            drift,
            self._accelerations,
            trial.view,
            self._strain,
        )
        if not count:
            return False
        problem = self._nearing(count) or self._leaving(count)
        if problem:
            self._strain[0], self.hindrance = 0.0, problem
            return False
        self._stop, self._trial = trial, self._stop
        self._at, self._end = 0, count
        return True

    def _nearing(self, count: int) -> str:
        """Return which singularity the first rows of the trial come too near to, or nothing."""
        kinds = len(self._now)
        if not (kinds and count):
            return ""
        if self._reserves is None:
            self._reserves = Rows(LONGEST_STOP, kinds)
        self._mechanism.reserves(self._trial, self._reserves, count)
        for place, one in enumerate(self._now):
            value = min(self._reserves.flat[place : kinds * count : kinds])
            if value < one.least_followed and value < one.value:
                return f"the {one.name} would be {value:.3g} {one.unit} from its singularity"
        return ""

    def _leaving(self, count: int) -> str:
        """Return how far the stop of the trial would end from the line, or nothing."""
        most = self.limits.path_tolerance
        if most == inf:
            return ""
        away = self.line.distance(self._mechanism.forward(self._trial[count - 1])[1])
        if away <= most:
            return ""
        text = f"the tool would leave the straight line by {1e3 * away:.3g} mm"
        return f"{text}, the path_tolerance is {1e3 * most:.3g} mm"

    def _reason(self) -> str:
        """Return in words why a stop was refused, as far as an operator can change that."""
        kind, place, value, _ = self._strain
        if kind not in _REFUSED:
            return self.hindrance
        axis = self._mechanism.axes[int(place)].name if kind == 1 else ""
        return _REFUSED[int(kind)].format(axis=axis, value=value)

    def _end_of_stop(self) -> tuple[Quaternion, Vector3]:
        return self._mechanism.forward(self._stop[self._end - 1])

    # The wanted step

    def _advance(self, found: ReferenceState | PreviewState) -> None:
        """Take the largest part of the step towards a reference in hand that has a stop."""
        place = self._place(found)
        around = self._around(found)
        self._keep_line(found, place, is_direct=around is None)
        rows, is_way = None, around is not None
        self.hindrance = ""
        if around is None:
            poses = self._poses(found, place)
            rows, around = self._solved(poses), difference(self._guard.q, found.q)
            is_way = rows is None
        if is_way:
            rows = self._towards(around, plus(place.position, self._guard.position, -1.0))
        if rows is not None:
            self._pursue(rows, is_way=is_way)
            if not is_way:
                self._note_range(rows)
            self._take_largest_part()

    def _keep_line(
        self, found: ReferenceState | PreviewState, place: Place, *, is_direct: bool
    ) -> None:
        """Begin a straight line if there is another target at rest, with no cone before it."""
        rates = found.omega, found.alpha, place.velocity, place.next_acceleration
        if not is_direct or rates != (ZERO, ZERO, ZERO, ZERO):
            self.line.clear()
        elif not self.line.leads_to(goal := (found.q, place.position)):
            self.line.begin(goal, self._guard.position, self._end_of_stop()[1])

    def _pursue(self, reference: Rows, *, is_way: bool) -> None:
        """Find the accelerations to aim at, towards joints or along a way."""
        if len(reference) > 1:
            gains = self._rest.softened(self._period)
            spare = self._need.spare
        else:
            gains, spare = self._rest, FULL
        following = array("d", (CAUTION, *gains, *spare))
        kernels.pursue_joints(
            self._chain,
            self._axes.view,
            self._tool_limits,
            self._period,
            self._joints.view,
            reference.view,
            is_way,
            following,
            self._taken,
            self._goal,
            self._accelerations,
        )
        if len(reference) > 1:
            self._need.note(self._taken)
        else:
            self._need.forget()

    def _note_range(self, reference: Rows) -> None:
        """Note which axis cannot go to a reference because its range ends."""
        wanted = reference[0]
        if wanted != (goal := tuple(self._goal)):
            apart = [abs(a - b) for a, b in zip(wanted, goal, strict=True)]
            place = apart.index(max(apart))
            axis = self._mechanism.axes[place].name
            self.hindrance = _REFUSED[1].format(axis=axis, value=goal[place])

    def _take_largest_part(self) -> None:
        """Take the largest part of the wanted step in hand that has a stop."""
        guard, h = self._guard, self._period
        wanted, braking = self._accelerations, None
        for part in PARTS:
            if part < 1.0:
                if braking is None:
                    states = zip(self._stop[self._at], guard.joints, guard.joint_rates, strict=True)
                    braking = [((a - x) / h - v) / h for a, x, v in states]
                mixed = [b + part * (a - b) for a, b in zip(wanted, braking, strict=True)]
                self._accelerations = array("d", mixed)
            if self._rolls_out():
                return
            self.hindrance = self._reason()

    def _place(self, found: ReferenceState | PreviewState) -> Place:
        """Return where the position should be; where the stop ends if no target says so."""
        guidance = self._guidance
        place = guidance.place
        if place is None:
            if self._anchor is None:
                self._anchor = self._end_of_stop()[1]
            return Place(self._anchor, ZERO)
        self._anchor = None
        if guidance.preview.is_on and isinstance(found, ReferenceState):
            return Place(guidance.preview.end.position, ZERO)
        return place

    def _poses(
        self, found: ReferenceState | PreviewState, place: Place
    ) -> list[tuple[Quaternion, Vector3]]:
        """Return the reference now, one and two cycles before, and a cycle later.

        Only the first if the reference is at rest.
        """
        h, q, position = self._period, found.q, place.position
        poses = [(q, position)]
        rates = found.omega, found.alpha, place.velocity, place.next_acceleration
        if rates == (ZERO, ZERO, ZERO, ZERO):
            return poses
        omega, alpha = found.omega, found.alpha
        if isinstance(found, PreviewState):
            later = found.next_alpha
        else:
            # The velocity of a step is that of its middle.
            later = alpha = plus(alpha, found.lead, 1.0)
            omega = plus(omega, found.alpha, -0.5 * h)
        velocity = place.velocity
        ahead = plus(omega, later, h), plus(velocity, place.next_acceleration, h)
        for _ in range(2):
            q = multiply(q, exp(plus(ZERO, omega, -h)))
            position = plus(position, velocity, -h)
            poses.append((q, position))
            omega = plus(omega, alpha, -h)
            velocity = plus(velocity, place.acceleration, -h)
        turn, way = ahead
        q, position = multiply(found.q, exp(plus(ZERO, turn, h))), plus(place.position, way, h)
        return [*poses, (q, position)]

    def _solved(self, poses: list[tuple[Quaternion, Vector3]]) -> Rows | None:
        """Return the joints for *poses*, on the branch next to the last goal.

        ``None`` if the device does not reach there, or only past a singularity.
        """
        (q, position), count = poses[0], len(poses)
        jump = max(norm(difference(self._pose[0], q)), dist(self._pose[1], position))
        near = self._guard.joints if jump > JUMP else tuple(self._goal)
        given, found = Rows(count, 7), Rows(count, len(near))
        for row, (q, position) in enumerate(poses):
            given[row] = (*q, *position)
        if self._mechanism.follow(given, near, found, count) < count:
            self.hindrance = "the device does not reach there"
            return None
        self.hindrance = self._between(found[0])
        if self.hindrance:
            return None
        self._pose = poses[0]
        return found

    def _between(self, goal: Joints) -> str:
        """Return which singularity lies on the way to a goal, or an empty string."""
        start = self._guard.joints
        away = max(abs(a - b) for a, b in zip(goal, start, strict=True))
        count = min(ceil(away / LOOK), LONGEST_STOP)
        for k in range(count):
            share = (k + 1) / count
            self._trial[k] = [a + share * (b - a) for a, b in zip(start, goal, strict=True)]
        return self._nearing(count)

    def _towards(self, turn: Vector3, way: Vector3) -> Rows | None:
        """Return the way of the joints along a turn and a displacement of the tool.

        A small part of it shows how they turn; ``None`` if they cannot.
        """
        guard = self._guard
        size = max(norm(turn), norm(way))
        share = min(PROBE / size, 1.0) if size > 0.0 else 1.0
        q = normalize(multiply(guard.q, exp(plus(ZERO, turn, share))))
        found = self._mechanism.nearest(q, plus(guard.position, way, share), guard.joints)
        if found is None:
            return None
        self._goal[:] = array("d", guard.joints)
        return Rows(
            1, len(found), [(a - b) / share for a, b in zip(found, guard.joints, strict=True)]
        )

    def _around(self, found: ReferenceState | PreviewState) -> Vector3 | None:
        """Return the turn to aim along around keep-out cones; ``None`` for the direct way."""
        detour, room, q = self._detour, self._room, self._guard.q
        if detour is None or room is None:
            return None
        room.forget()
        # Targets keep farther away than stops, which then leave the law alone.
        reserve = 2.0 * RESERVE
        if not room.is_within(q, norm(difference(q, found.q)) + reserve):
            detour.forget()
            return None
        return detour.turn(q, found.q, reserve)
