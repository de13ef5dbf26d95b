"""The one judge of setpoints: it differentiates them backwards, from first principles.

It shares no code with the guard or the planner.  In the world it sits between each servo and its
driver, so that a test fails whose servo breaks one of these rules, whatever the test is about:

* tool and axes keep the limits of the device, and the axes their ranges;
* orientation, position and axes are continuous, from rest to rest;
* a device with a fault comes to rest, and then stays there until it is enabled again;
* a device that is let go is at rest.

A device whose setpoints have joints is at rest while its axes stand.  At the end of a stop between
two records of its path, the servo sets the pose to that of the axes.
"""

from __future__ import annotations

import itertools
import math

TOLERANCE = 1.001
GAP_NS = 50_000_000
"""A device that is sent nothing for longer than this, and three cycles, has come to rest."""

ROUNDING, AXIS_ROUNDING = 1e-14, 1e-11
"""Rounding of a difference of orientations, and of angles of many turns, rad."""

UNKNOWN = (math.nan,) * 3

AT_REST = 1e-6
"""Velocity of a device at rest, rad/s or m/s."""

LONGEST_STOP_NS = 1_000_000_000
"""Longest time from a fault to rest."""

RATES, KINDS = ("velocity", "acceleration", "jerk"), ("", "linear_")


class Judge:
    """Look at each setpoint of one device.

    Args:
        limits: largest rates by name: ``velocity``, ``acceleration``, ``jerk`` of the tool in rad
            and s, ``linear_velocity``, ``linear_acceleration``, ``linear_jerk`` of its position in
            m and s; those that are missing are not limited.
        period: of the setpoints, s.
        violate: is called with each violation in words.

    Attributes:
        axes: limits of the axes, as ``orientd.driver.AxisLimits``.
        peaks: largest rates so far, by the names of limits, in rad or m and s.
        gap_ns: a device that is sent nothing for longer has come to rest.
        rests: how often the device was at rest because nothing was sent for a while.
    """

    def __init__(self, limits, period, violate):
        self.limits, self.period, self.violate, self.axes = limits, period, violate, ()
        self.peaks, self.rests = {kind + rate: 0.0 for kind in KINDS for rate in RATES}, 0
        self.gap_ns = max(GAP_NS, round(3e9 * period))
        self._at, self._led_ns, self._rest_by_ns = None, 0, None
        self.stand()

    def stand(self):
        """Expect the device to be at rest."""
        self._turns = self._moves = ((0.0,) * 3,) * 2
        self._joints, self._joint_rates, self._joints_begin = (), None, 0.0

    def rest(self, now_ns):
        """Expect the next setpoint from rest: nothing was sent for a while."""
        self.rests, self._led_ns = self.rests + 1, now_ns
        self.stand()

    def go_on(self, now_ns):
        """Expect the next setpoint in motion, though the last deadline was long ago."""
        self._led_ns = now_ns

    def begin_in_motion(self):
        """Expect the next setpoint anywhere, with whatever velocity and acceleration."""
        self._turns = self._moves = (UNKNOWN,) * 2
        self._joints, self._joint_rates, self._joints_begin = (), None, math.nan
        self._at = None

    def anchor(self, q=None, position=None):
        """Expect the next setpoint next to a pose, or anywhere, from rest; a fault is over."""
        self.stand()
        self._at, self._rest_by_ns = None if q is None else (q, position), None

    def fail(self, now_ns):
        """Expect that the device comes to rest and stays there: it has a fault."""
        if self._rest_by_ns is None:
            self._rest_by_ns = now_ns + LONGEST_STOP_NS

    def is_led(self, now_ns):
        """Return whether a setpoint has come lately."""
        return now_ns - self._led_ns <= self.gap_ns

    def is_moving(self, now_ns):
        """Return whether the setpoints move the device."""
        return self.is_led(now_ns) and any(abs(speed) > AT_REST for speed in self._speeds())

    def _speeds(self):
        """Return the velocities of the axes, or those of tool and position if there are none."""
        if self._joint_rates is not None:
            return [speed for speed, _ in self._joint_rates]
        return [*self._turns[0], *self._moves[0]]

    def slows(self, q):
        """Return whether the device would be at half of its speed, or less, at an orientation."""
        before = q if self._at is None else self._at[0]
        speed = math.hypot(*self._turns[0])
        return math.hypot(*turn(before, q)) / self.period <= 0.5 * speed and speed > AT_REST

    def let_go(self, now_ns):
        """Look whether a device that is let go is at rest."""
        if self.is_moving(now_ns) and self._rest_by_ns is None:
            self.violate(f"let go at {math.hypot(*self._turns[0]):.3g} rad/s")
        self.stand()

    def take(self, now_ns, q, position=(0.0, 0.0, 0.0), joints=()):
        """Look at a setpoint."""
        if self._led_ns and not self.is_led(now_ns):
            self.rest(now_ns)
        self._led_ns = now_ns
        before, self._at = self._at, (q, position)
        if before is not None or not math.isnan(self._turns[0][0]):
            before = before or self._at
            move = tuple(b - a for a, b in zip(before[1], position, strict=True))
            self._turns = self._look("", turn(before[0], q), self._turns, ROUNDING)
            self._moves = self._look("linear_", move, self._moves, ROUNDING)
        self._look_at_axes(joints)
        if self._rest_by_ns is not None:
            if not self.is_moving(now_ns):
                self._rest_by_ns = 0
            elif now_ns > self._rest_by_ns:
                self.violate(f"moves after a fault at {math.hypot(*self._speeds()):.3g} rad/s")

    def _look(self, kind, step, before, rounding):
        """Differentiate a step, and compare each rate with its limit; return the rates."""
        rates, rounding = [tuple(x / self.period for x in step)], rounding / self.period
        for rate in before:
            rates.append(_rate(rate, rates[-1], self.period))
        for name, rate in zip(RATES, rates, strict=True):
            limit, size = self.limits.get(kind + name, math.inf), math.hypot(*rate)
            is_unknown = all(map(math.isfinite, step)) and math.isnan(size)
            if not size <= TOLERANCE * limit + rounding and not is_unknown:
                self.violate(f"{kind}{name} {size:.6g}, at most {limit:g}")
            self.peaks[kind + name] = max(self.peaks[kind + name], size)
            rounding /= self.period
        return rates[0], rates[1]

    def _look_at_axes(self, joints):
        before, self._joints = self._joints, joints
        if not joints or not self.axes or len(before) != len(joints):
            self._joint_rates = None
            return
        known = self._joint_rates or [(self._joints_begin,) * 2] * len(joints)
        found = []
        for axis, was, at, (speed, change) in zip(self.axes, before, joints, known, strict=True):
            rates = [(at - was) / self.period]
            rates.append((rates[0] - speed) / self.period)
            rates.append((rates[1] - change) / self.period)
            rounding = AXIS_ROUNDING
            for name, rate in zip(RATES, rates, strict=True):
                rounding /= self.period
                limit, is_unknown = getattr(axis, name), math.isnan(rate) and math.isfinite(at)
                if not abs(rate) <= TOLERANCE * limit + rounding and not is_unknown:
                    self.violate(f"{name} of {axis.name} {rate:.6g}, at most {limit:g}")
            if not axis.low - axis.resolution <= at <= axis.high + axis.resolution:
                self.violate(f"{axis.name} at {at:.6g}, within {axis.low:g} and {axis.high:g}")
            found.append((rates[0], rates[1]))
        self._joint_rates = found


def _rate(before, after, period):
    return tuple((b - a) / period for a, b in zip(before, after, strict=True))


def turn(p, q):
    """Return the rotation vector from *p* to *q*, of either sign, in the frame of *p*."""
    w, x, y, z = p
    a, b, c, d = q
    scalar = w * a + x * b + y * c + z * d
    vector = (
        w * b - x * a - y * d + z * c,
        w * c - y * a - z * b + x * d,
        w * d - z * a - x * c + y * b,
    )
    if scalar < 0.0:
        scalar, vector = -scalar, tuple(-v for v in vector)
    sine = math.hypot(*vector)
    share = 2.0 * math.atan2(sine, scalar) / sine if sine > 0.0 else 2.0
    return tuple(share * v for v in vector)


def judged(setpoints, limits, period, *, is_moving=False):
    """Return the violations of recorded setpoints, and the judge that found them.

    Args:
        setpoints: of a driver, as ``orientd.driver.Setpoint``, in their order.
        limits: as for :class:`Judge`.
        period: of the setpoints, s.
        is_moving: whether they begin in motion.
    """
    found = []
    judge = Judge(limits, period, found.append)
    if is_moving:
        judge.begin_in_motion()
    times = [setpoint.time_ns for setpoint in setpoints]
    gaps = [0, *(b - a for a, b in itertools.pairwise(times)), 0]
    for setpoint, before, after in zip(setpoints, gaps, gaps[1:], strict=False):
        # A late cycle writes its deadline: a process that stood still within a cycle writes the
        # first setpoint from rest before the gap.
        if max(before, after) + 2e9 * period > judge.gap_ns and judge.slows(setpoint.q):
            judge.rest(setpoint.time_ns)
        elif judge.gap_ns < before <= 2 * judge.gap_ns:
            # It goes on: the cycle before the gap was as late as its process stood still, so the
            # device was sent nothing for less than the gap, and had not come to rest.
            judge.go_on(setpoint.time_ns)
        judge.take(setpoint.time_ns, setpoint.q, setpoint.position, setpoint.joints)
    return found, judge


def limits_of(limits):
    """Return the limits of a device by name, as a :class:`Judge` takes them."""
    names = ("velocity", "acceleration", "jerk", "linear_velocity", "linear_acceleration")
    return {name: getattr(limits, name) for name in names}
