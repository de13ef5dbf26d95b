"""Nothing inside a keep-out cone is written, by any command; cones that move do so slowly."""

import json
from math import degrees, radians

import numpy as np
import pytest
from rig import PERIOD, TERMS, Rig, peaks, turn

from orientd.driver import ZERO
from orientd.errors import Fault
from orientd.floats import exp
from orientd.keep_out import KeepOut
from orientd.servo.guard import Guard
from orientd.servo.keep_out_cones import MOST_DRIFT, KeepOutCones
from orientd.servo.process import ProcessSettings
from orientd.stream import Answer, Command, NoteKind, ServoState
from orientd.sun import Sun

LIMITS = (2.5, 17.0, 8500.0)


def about_z(degrees_):
    return exp((0.0, 0.0, radians(degrees_)))


def cone_at(azimuth, half_angle, name="laser"):
    a = radians(azimuth)
    return KeepOut(name, (float(np.cos(a)), float(np.sin(a)), 0.0), radians(half_angle))


def clearance(rig, cone):
    return degrees(min(cone.clearance(s.q, 0) for s in rig.driver.setpoints))


def keeps_limits(rig):
    return all(a <= b * 1.001 for a, b in zip(peaks(rig.sent()), LIMITS, strict=True))


def test_a_path_into_a_cone_is_stopped_with_a_fault_that_names_it():
    cone = cone_at(60.0, 10.0)
    rig = Rig(cones=(cone_at(-90.0, 30.0, "window"), cone))
    rig.start(turn(angle=1.5, axis=(0.0, 0.0, 1.0)))
    rig.run_until(lambda servo: servo.state is ServoState.FAULT)
    assert rig.cycle.fault == Fault.LIMIT_GUARD
    assert "inside the keep-out cone 'laser'" in rig.notes(NoteKind.FAULT)[0].text
    assert "deg" in rig.notes(NoteKind.FAULT)[0].text
    assert keeps_limits(rig)


@pytest.mark.parametrize(("step", "passes"), [(-0.001, True), (0.001, False), (0.0, True)])
def test_from_inside_only_a_setpoint_outwards_passes(step, passes):
    guard = Guard(PERIOD, KeepOutCones([cone_at(10.0, 20.0)], PERIOD))
    guard.anchor(about_z(0.0), ZERO)
    problem = guard.admit(about_z(step), ZERO, TERMS)
    assert (problem == "") is passes
    assert passes or "10 deg inside the keep-out cone 'laser'" in problem


def tracked(cones, q, seconds=2.0):
    rig = Rig(cones=cones)
    assert rig.ask(Command.ENABLE)[0] is Answer.DONE
    assert rig.ask(Command.TRACK)[0] is Answer.DONE
    for _ in range(round(seconds / 0.04)):
        time_ns = rig.clock.now_ns()
        rig.memory.targets.publish(
            time_ns, time_ns + 500_000_000, *q, 0.0, 0.0, 0.0, *[float("nan")] * 3
        )
        rig.run(20)
    return rig


def test_a_tracked_target_inside_is_held_at_the_edge_and_a_stop_ends_there():
    cone = cone_at(60.0, 20.0)
    rig = tracked((cone,), about_z(55.0))
    assert rig.cycle.state is ServoState.TRACKING
    assert 0.0 <= degrees(cone.clearance(rig.cycle.q, 0)) < 0.15
    assert rig.ask(Command.STOP)[0] is Answer.DONE
    rig.run_until(lambda servo: not servo.is_moving)
    assert rig.cycle.state is ServoState.HOLDING
    assert clearance(rig, cone) >= 0.0
    assert keeps_limits(rig)


@pytest.mark.parametrize("cycles", range(20, 260, 40))
@pytest.mark.parametrize("command", [Command.STOP, Command.HALT])
def test_a_stop_of_tracking_towards_a_cone_ends_outside(command, cycles):
    cone = cone_at(60.0, 20.0)
    rig = tracked((cone,), about_z(70.0), seconds=0.0)
    time_ns = rig.clock.now_ns()
    rig.memory.targets.publish(
        time_ns, time_ns + 10**10, *about_z(70.0), 0.0, 0.0, 0.0, *[float("nan")] * 3
    )
    rig.run(cycles)
    assert rig.ask(command)[0] is Answer.DONE
    rig.run_until(lambda servo: not servo.is_moving)
    assert rig.cycle.state is ServoState.HOLDING
    assert clearance(rig, cone) >= 0.0
    assert keeps_limits(rig)


def test_a_step_of_the_wall_clock_turns_the_sun_slowly():
    hour_ns = 3_600_000_000_000
    now_ns = 1_780_000_000 * 10**9
    cones = KeepOutCones([KeepOut("sun", Sun(48.0, 11.0), 0.1)], PERIOD, lambda: now_ns)
    before = np.array(cones.directions[0])
    now_ns += 6 * hour_ns
    for _ in range(500):
        cones.tick()
    after = np.array(cones.directions[0])
    assert np.linalg.norm(after - before) == pytest.approx(MOST_DRIFT, rel=0.01)
    for _ in range(500 * 180):
        cones.tick()
    assert cones.directions[0] == Sun(48.0, 11.0).direction(now_ns)


def test_the_sun_is_followed_by_the_wall_clock():
    now_ns = 1_780_000_000 * 10**9
    cones = KeepOutCones([KeepOut("sun", Sun(48.0, 11.0), 0.1)], PERIOD, lambda: now_ns)
    now_ns += 10**9
    for _ in range(500):
        cones.tick()
    assert cones.directions[0] == Sun(48.0, 11.0).direction(now_ns)


def test_cones_reach_the_servo_process_as_they_are():
    cones = (
        KeepOut("sun", Sun(48.0, 11.0, 80.0), 0.1, 0.2),
        KeepOut("mast", (0.0, 0.6, 0.8), 0.3, axis=(0.0, 0.0, 1.0)),
    )
    settings = ProcessSettings(
        "d", "m:D", {"a": 1}, 2_000_000, 0, 16, 16, 1, 1, 1, 0, 0, 1, "/r", keep_out=cones
    )
    text = settings.to_json()
    assert json.loads(text)["device"] == "d"
    assert ProcessSettings.from_json(text) == settings
