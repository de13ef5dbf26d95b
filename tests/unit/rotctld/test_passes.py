"""When the pass of a known target is planned once more."""

import math
import threading
import time
from types import SimpleNamespace

import numpy as np
import pytest

from orientd.errors import DeadlineError, PlanError
from orientd.protocol import control_pb2 as pb
from orientd_rotctld.passes import Passes
from orientd_rotctld.pointer import Pointer
from orientd_rotctld.ranges import Ranges
from orientd_rotctld.sky import Target
from orientd_serving.pointing import Direction

POINT = np.array([1.0, 0.0, 0.0])
RANGES = Ranges((-180.0, 540.0), (-90.0, 90.0))


def nothing():
    """Point nowhere instead of along a pass."""


class Refusing:
    """A device at rest, whose daemon plans no pass."""

    name = "antenna"

    def __init__(self, error):
        self.asked, self.robot, self._error = 0, self, error
        self.lock, self.rests, self.goals = threading.RLock(), 0, []

    def report(self):
        return pb.DeviceReport(cycle=pb.Cycle(q=pb.Quaternion(w=1.0)))

    def move(self, poses, **_):
        self.goals += poses
        return SimpleNamespace(is_done=False)

    def rest(self):
        self.rests += 1

    def plan(self, request, *, device):
        self.asked += 1
        raise self._error


def asked_twice(error, rise):
    """Return how often a pass is planned for which a client asks twice, *rise* s before it."""
    begin = time.time() + rise

    def at(times):
        height = 0.01 * (np.asarray(times) - begin)
        height[times > begin + 100.0] = -0.1
        return np.stack([np.cos(height), np.zeros(len(height)), np.sin(height)], axis=-1)

    served = Refusing(error)
    passes = Passes(served, [Target("one", at)], ranges=RANGES, notify=lambda _: None)
    for _ in range(2):
        passes.takes(POINT, nothing)
        planning = passes._planning
        if planning is not None:
            planning.join()
    return served.asked


@pytest.mark.parametrize(
    ("error", "rise", "count"),
    [
        (DeadlineError("planning took longer than 10 s"), 50.0, 2),
        (DeadlineError("planning took longer than 10 s"), -0.5, 1),
        (PlanError("the axes cannot follow"), 50.0, 1),
    ],
)
def test_a_plan_that_took_too_long_is_tried_again_before_the_rise_only(error, rise, count):
    assert asked_twice(error, rise) == count


def pointer_of(served, rise, notify=lambda _: None):
    """Return the pointer of a device, and the passes of a target that rises in the north."""
    begin = time.time() + rise

    def at(times):
        height = 0.01 * (np.asarray(times) - begin)
        height[times > begin + 100.0] = -0.1
        return np.stack([np.cos(height), np.zeros(len(height)), np.sin(height)], axis=-1)

    passes = Passes(served, [Target("one", at)], ranges=RANGES, notify=notify)
    return Pointer(served, passes, RANGES), passes


def test_a_position_is_pointed_at_if_its_pass_cannot_be_planned():
    """It is moved to once, however often it is asked for."""
    served, lines = Refusing(PlanError("the axes cannot follow")), []
    pointer, passes = pointer_of(served, 50.0, lines.append)
    for _ in range(3):
        with served.lock:
            pointer.go(Direction(0.5, 0.0))
        passes._planning.join()
    (goal,) = served.goals
    assert math.degrees(2.0 * math.atan2(goal.z, goal.w)) == pytest.approx(-0.5)
    assert lines == [
        "one: no plan of the whole pass: the axes cannot follow; points at the position that was "
        "asked for instead"
    ]


def test_a_stop_while_a_pass_is_refused_moves_nothing():
    served = Refusing(PlanError("the axes cannot follow"))
    pointer, passes = pointer_of(served, 50.0)
    with served.lock:
        pointer.go(Direction(0.5, 0.0))
        passes.leave()
    passes._planning.join()
    assert served.goals == []


class Planning(Refusing):
    """A device whose daemon plans for as long as it is told to."""

    def __init__(self, *gates):
        super().__init__(None)
        self.gates, self.planning, self.stops, self.cancelled = gates, 0, 0, 0
        self.on_begin = lambda: None

    def plan(self, request, *, device):
        gate = self.gates[self.asked]
        self.asked += 1
        self.planning += 1
        gate.wait()
        self.planning -= 1
        return SimpleNamespace(start_time=0.0, certificate=SimpleNamespace(losses=()))

    def move(self, plan, *, start_time):
        self.start = start_time
        self.on_begin()
        return self

    def cancel(self):
        self.cancelled += 1

    def stop(self, name):
        self.stops += 1
        for gate in self.gates:
            gate.set()


def passes_of(served):
    return pointer_of(served, 400.0)[1]


def test_a_pass_that_is_left_while_the_daemon_takes_its_motion_does_not_begin():
    gate = threading.Event()
    gate.set()
    served = Planning(gate)
    passes = passes_of(served)
    served.on_begin = passes.leave
    assert passes.takes(POINT, nothing)
    passes._planning.join()
    assert served.cancelled == 1


def test_the_end_waits_for_every_plan_that_is_made():
    """A pass that was left is still planned when the next one is asked for."""
    first, second = threading.Event(), threading.Event()
    served = Planning(first, second)
    passes = passes_of(served)
    assert passes.takes(POINT, nothing)
    before = passes._planning
    passes.leave()
    assert passes.takes(POINT, nothing)
    first.set()
    before.join()
    passes.close()
    assert served.stops
    assert served.planning == 0


def test_a_pass_that_is_left_before_its_plan_brings_nothing_to_rest():
    """What moves by then is the position elsewhere that the client has asked for."""
    served = Planning(threading.Event())
    passes = passes_of(served)
    with served.lock:
        assert passes.takes(POINT, nothing)
        planning = passes._planning
        passes.leave()
    planning.join()
    assert (served.rests, served.asked) == (0, 0)


def test_a_pass_that_is_left_while_it_is_planned_does_not_begin():
    gate, begun = threading.Event(), []
    served = Planning(gate)
    served.on_begin = lambda: begun.append(True)
    passes = passes_of(served)
    assert passes.takes(POINT, nothing)
    with served.lock:
        gate.set()
        passes.leave()
    passes._planning.join()
    assert not begun


@pytest.mark.parametrize(("rise", "least"), [(60.0, 0.0), (1.0, 2.0), (-5.0, 3.0)])
def test_what_a_pass_loses_counts_from_what_was_asked(rise, least):
    """A plan begins in three seconds: until then a target that has risen is lost."""
    gate, lines = threading.Event(), []
    gate.set()
    served = Planning(gate)
    pointer, passes = pointer_of(served, rise, lines.append)
    pointer.go(Direction(0.0, max(0.0, math.degrees(-0.01 * rise))))
    passes._planning.join()
    (line,) = lines
    lost = served.start - passes._pass.start
    assert lost >= least
    assert f"off target for {lost:.1f} s" in line


def test_a_pass_that_leaves_the_ranges_is_not_planned():
    """The position itself is in the ranges, and is pointed at."""
    served, lines = Refusing(PlanError("no plan was asked for")), []

    def at(times):
        height = 0.02 * (np.asarray(times) - time.time())
        return np.stack([np.cos(height), np.zeros(len(height)), np.sin(height)], axis=-1)

    low = Ranges((-180.0, 540.0), (0.0, 40.0))
    passes = Passes(served, [Target("one", at)], ranges=low, notify=lines.append)
    for _ in range(3):
        assert not passes.takes(POINT, nothing)
    assert served.asked == 0
    (line,) = lines
    assert line.startswith("one: the pass leaves the ranges (--azimuth -180:540, --elevation 0:40)")
    assert line.endswith("; points at each position instead")
