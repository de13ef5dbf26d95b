"""A motion of an arm is done once its joints have arrived, or says how far they are behind."""

import math
import os
import random

import pytest
from ur_rig import device_of, fault_of, recover, swing, until

from orientd.daemon.device import EventKind
from orientd.errors import Fault

pytest.importorskip("rtde_control")

CASES = int(os.environ.get("ORIENTD_CASES", "4"))
TOLERANCE = math.radians(0.5)


def end_of(device, events, number):
    """Wait until motion *number* has ended; return its event."""
    ends = EventKind.MOTION_DONE, EventKind.MOTION_STOPPED

    def found():
        device.snapshot()
        return [one for one in events if one.kind in ends and one.motion_number == number]

    return until(found, lambda: f"the end of motion {number} in {events}", 30.0)[0]


def farthest(a, b):
    return max(abs(x - y) for x, y in zip(a, b, strict=True))


def test_motion_is_done_only_once_the_joints_have_arrived(ur_robot):
    events = []
    with device_of(ur_robot.host, on_event=events.append, lookahead=0.2) as device:
        queued = swing(device, angle=0.4, seconds=1.2)
        assert end_of(device, events, queued.number).kind is EventKind.MOTION_DONE
        done = ur_robot.state()["actual_q"]
        ur_robot.wait_until(lambda s: max(map(abs, difference_of(s))) < 1e-6)
        assert farthest(done, ur_robot.state()["target_q"]) < 1.05 * TOLERANCE


def difference_of(state):
    return [a - b for a, b in zip(state["target_q"], state["actual_q"], strict=True)]


def test_joint_that_does_not_arrive_is_named_with_how_far_it_is_behind(ur_robot):
    events = []
    with device_of(ur_robot.host, on_event=events.append) as device:
        queued = swing(device, angle=0.3, seconds=2.0)
        until(lambda: device.snapshot().path_time > 0.9, "the turning point")
        ur_robot.ask("block 6")
        ended = end_of(device, events, queued.number)
        assert ended.kind is EventKind.MOTION_STOPPED
        fault, text, _ = fault_of(device)
        assert fault is Fault.DEVICE_FAULT
        assert "joint wrist 3 has not arrived: it is " in text
        behind = float(text.split("it is ")[1].split(" deg")[0])
        off = math.degrees(abs(difference_of(ur_robot.state())[5]))
        assert behind == pytest.approx(off, abs=0.1)
        assert behind > 3.0
        ur_robot.ask("unblock 6")
        recover(device)


def test_tolerance_is_an_option(ur_robot):
    events = []
    with device_of(ur_robot.host, on_event=events.append, arrival_tolerance_deg=10) as device:
        ur_robot.ask("block 6")
        queued = swing(device, angle=0.02, seconds=0.8)
        assert end_of(device, events, queued.number).kind is EventKind.MOTION_DONE


def test_random_motions_arrive_at_any_lookahead_and_slider(ur_robot):
    generator = random.Random(int(os.environ.get("ORIENTD_SEED", "3")))
    events, worst = [], 0.0
    with device_of(ur_robot.host, on_event=events.append) as device:
        for case in range(CASES):
            slider = generator.choice((1.0, 1.0, 0.5, 0.25))
            ur_robot.ask(f"slider {slider}")
            ur_robot.wait_until(lambda s, wanted=slider: abs(s["speed_scaling"] - wanted) < 1e-6)
            options = {"lookahead": generator.uniform(0.03, 0.2)}
            angle = generator.uniform(0.02, 0.4)
            queued = swing(
                device,
                angle=angle,
                seconds=2.0 * max(0.6, angle / generator.uniform(0.3, 0.7)),
                device_options=options,
            )
            ended = end_of(device, events, queued.number)
            assert ended.kind is EventKind.MOTION_DONE, (case, slider, options, ended.text)
            done = ur_robot.state()["actual_q"]
            # A slow slider lets the model creep for long.
            ur_robot.ask("slider 1")
            ur_robot.wait_until(lambda s: s["is_still"])
            worst = max(worst, farthest(done, ur_robot.state()["actual_q"]))
            if device.snapshot().fault is not Fault.NONE:
                device.reset()
    print(f"{CASES} motions, at most {math.degrees(worst):.3f} deg from their ends when done")
    assert worst < 1.05 * TOLERANCE
