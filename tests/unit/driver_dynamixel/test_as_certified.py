"""The certified axes of a motion go over the wire; an independent reader checks them."""

import math

import numpy as np
import pytest
from pole_passes import AXES, over_the_top
from reference.wire import WireReader
from rig import PERIOD
from rig import Rig as LoopRig
from scipy.interpolate import CubicHermiteSpline

from orientd import motion_file
from orientd.daemon.device import queue
from orientd.model.limits import Limits
from orientd.planner.device_planner import DevicePlanner
from orientd.planner.state import State
from orientd.stream.records import Answer, Command, ServoState

LIMITS = Limits(1.5, 8.0, 1500.0, 1.0, 10.0)
TICKS = 4096 / math.tau


class Watched:
    """A planned motion on an emulated gimbal whose bus is read on the way to the servos."""

    def __init__(self, rig, gimbal_loop, request, **options):
        self.gimbal = rig(rate_hz=500, is_paced=False, latency_ms=4.0, axes=AXES, **options)
        self.loop = gimbal_loop(self.gimbal)
        self.reader, write = WireReader(), self.gimbal.port.writePort

        def tapped(packet):
            sent = write(packet)
            self.reader.take(bytes(packet), self.gimbal.clock.now_ns() * 1e-9)
            return sent

        self.gimbal.port.writePort = tapped
        assert self.loop.ask(Command.ENABLE)[0] is Answer.DONE
        cycle = self.loop.cycle
        planner = DevicePlanner(self.gimbal.driver, limits=LIMITS, period=PERIOD)
        self.motion = planner.plan(
            motion_file.parse(request), start=State.at_rest(cycle.q), joints=cycle.sent_joints
        )
        rows = self.motion.records(0, self.motion.record_count)
        self.joints, self.rates = rows[:, 16:19], rows[:, 24:27]
        first = LoopRig.lay(
            self.loop, rows[:, :4], rows[:, 4:7], rows[:, 7:10], position=rows[:, 10:13],
            velocity=rows[:, 13:16], joints=rows[:, 16:],
        )  # fmt: skip
        facts = self.motion.facts
        self.first, self.begun = first, len(self.reader.written)
        self.servo_limits = queue.servo_limits_of(facts.limits, facts.brake_rate)
        answer = self.loop.ask(Command.START, path_index=first, servo_limits=self.servo_limits)
        assert answer == (Answer.DONE, "")

    def goals(self):
        """Return the goals written since the motion began, ticks, shape ``(n, 3)``."""
        return np.array([self.reader.goals(servo, self.begun) for servo in (1, 2, 3)]).T


@pytest.mark.parametrize(
    ("miss", "options"), [(40, {}), (2, {"max_deviation_deg": 3.0}), (4, {}), (0.0, {})]
)
def test_goals_on_the_wire_are_the_certified_angles_to_half_a_tick(rig, gimbal_loop, miss, options):
    it = Watched(rig, gimbal_loop, over_the_top(miss), **options)
    it.loop.run_until(lambda servo: servo.state is ServoState.HOLDING)
    # Where the motion begins the gimbal holds already.
    wanted, goals = 2048 + it.joints[1:] * TICKS, it.goals()
    assert len(goals) == len(wanted)
    assert np.abs(goals - wanted).max() <= 0.5 + 1e-6
    assert it.reader.damaged == 0
    # The angles read back are within the certified peaks, but for the rounding to ticks.
    found = {figure.name: figure for figure in it.motion.certificate.figures}
    for axis, row in zip(AXES, goals.T / TICKS, strict=True):
        fastest = found[f"velocity of {axis['name']}"]
        assert fastest.value <= fastest.limit * 1.001
        tick = 1.0 / TICKS / PERIOD
        assert np.abs(np.diff(row)).max() / PERIOD <= fastest.value + tick + 1e-6


@pytest.mark.parametrize("miss", [2, 8])
def test_goals_of_other_speeds_and_stops_are_on_the_certified_path_to_half_a_tick(
    rig, gimbal_loop, miss
):
    it = Watched(rig, gimbal_loop, over_the_top(miss))
    law = CubicHermiteSpline(np.arange(len(it.joints)), it.joints, it.rates * PERIOD)
    for cycle, (command, speed) in enumerate(
        [(Command.SPEED, 0.37), (Command.SPEED, 0.0), (Command.SPEED, 0.8), (Command.STOP, 1.0)], 1
    ):
        for _ in range(150 + 7 * cycle):
            it.loop.run()
            now = it.loop.cycle
            place = now.path_index - it.first + now.path_fraction
            assert it.goals()[-1] == pytest.approx(2048 + law(place) * TICKS, abs=0.5 + 1e-6)
        it.loop.ask(command, speed=speed)
    it.loop.run_until(lambda servo: servo.state is ServoState.HOLDING)
    now = it.loop.cycle
    assert it.goals()[-1] == pytest.approx(2048 + np.array(now.sent_joints) * TICKS, abs=0.51)
