"""What the daemon reports arrives as it was sent."""

import math
from dataclasses import fields, is_dataclass, replace

import numpy as np
import pytest

from orientd.driver import IDENTITY, ZERO
from orientd.errors import Fault
from orientd.planner import DEFAULT_LIMITS, Certificate, Peak
from orientd.rpc import control_pb2 as pb
from orientd.rpc.descriptions import MethodDescription
from orientd.rpc.reports import (
    DaemonReport,
    DeviceReport,
    Durations,
    Outcome,
    Plan,
    Progress,
    Samples,
    Statistics,
    Summary,
)
from orientd.rpc.wire.move import (
    plan_from_message,
    plan_to_message,
    progress_from_message,
    progress_to_message,
    samples_from_messages,
    summary_from_message,
    summary_to_message,
)
from orientd.rpc.wire.state import (
    cycle_from_message,
    cycle_to_message,
    daemon_from_message,
    daemon_to_message,
    device_from_message,
    device_to_message,
    method_from_message,
    method_to_message,
    tracking_error,
)
from orientd.rpc.wire.values import quaternion, vector
from orientd.stream import Cycle, CycleFlag, ServoState

QUARTER = (math.cos(0.1), 0.0, 0.0, math.sin(0.1))
CYCLE = Cycle(
    index=2**40,
    deadline_ns=10**15,
    lateness_ns=-5,
    work_ns=40_000,
    feedback_time_ns=10**15 - 7,
    path_index=12,
    state=ServoState.STREAMING,
    fault=Fault.NONE,
    motion=3,
    flags=CycleFlag.FEEDBACK | CycleFlag.WRITTEN,
    overruns=4,
    missed=5,
    path_fraction=0.25,
    speed=0.5,
    q=QUARTER,
    omega_body=(1.0, 2.0, 3.0),
    alpha_body=(4.0, 5.0, 6.0),
    position=(0.1, 0.2, 0.3),
    feedback_q=IDENTITY,
    feedback_omega_body=(7.0, 8.0, 9.0),
    feedback_position=(0.4, 0.5, 0.6),
)
BLIND = replace(
    CYCLE,
    feedback_time_ns=0,
    flags=0,
    feedback_q=IDENTITY,
    feedback_omega_body=ZERO,
    feedback_position=ZERO,
)
DEVICE = DeviceReport(
    name="arm",
    driver="loopback",
    rate_hz=500.0,
    limits=DEFAULT_LIMITS,
    state=ServoState.FAULT,
    fault=Fault.LIMIT_GUARD,
    fault_text="too fast",
    is_paused=True,
    speed=0.5,
    motion_number=3,
    motion_id="abc",
    path_time=1.5,
    duration=2.5,
    servo_pid=77,
    scheduling="SCHED_FIFO 80",
    is_memory_locked=True,
    cycle=CYCLE,
    lead=0.1,
    is_free=True,
    cycle_age=0.25,
)
CERTIFICATE = Certificate(
    rate_hz=500.0,
    duration=2.0,
    lead_in=0.25,
    lead_out=0.5,
    peak_velocity=Peak(1.0, 0.1, 2.5),
    peak_acceleration=Peak(2.0, 0.2, 17.0),
    peak_jerk=Peak(3.0, 0.3, 8500.0),
    peak_linear_velocity=Peak(4.0, 0.4, 10.0),
    peak_linear_acceleration=Peak(5.0, 0.5, 20.0),
    start_velocity_error=1e-9,
    end_velocity_error=2e-9,
    keyframe_error=3e-9,
    brake_rate=5.0,
    stop_time=0.2,
    usual_stop_time=0.1,
    notes=("one",),
    has_control_points=True,
)
STATISTICS = Statistics(
    cycles=10,
    overruns=2,
    missed=1,
    stalls=3,
    lateness=Durations(1.0, 2.0, 3.0, 4.0),
    work=Durations(5.0, 6.0, 7.0, 8.0),
    velocity=1.0,
    acceleration=2.0,
    jerk=3.0,
    path_error=1e-9,
    tracking_error=1e-3,
    start_velocity_error=0.0,
    end_velocity_error=1e-10,
)
PROGRESS = Progress(
    path_time=1.0,
    duration=2.0,
    state=ServoState.STOPPING,
    is_paused=False,
    speed=0.75,
    q=QUARTER,
    omega_body=(1.0, 2.0, 3.0),
    position=(4.0, 5.0, 6.0),
    lateness=1e-4,
    tracking_error=0.0,
    overruns=1,
)


@pytest.mark.parametrize(
    ("report", "to_message", "from_message"),
    [
        (CYCLE, cycle_to_message, cycle_from_message),
        (BLIND, cycle_to_message, cycle_from_message),
        (DEVICE, device_to_message, device_from_message),
        (replace(DEVICE, cycle=None, servo_pid=None), device_to_message, device_from_message),
        (
            DaemonReport("0.1", 7, 1.5, "/x", "/y.toml", "ana", 2.5),
            daemon_to_message,
            daemon_from_message,
        ),
        (
            MethodDescription("slerp", "a great arc", "Shoemake 1985", True, False, True),
            method_to_message,
            method_from_message,
        ),
        (
            Plan("abc", 2.0, 0.25, 1.5, (0.25, 1.0, 1.5), CERTIFICATE),
            plan_to_message,
            plan_from_message,
        ),
        (PROGRESS, progress_to_message, progress_from_message),
        (replace(PROGRESS, tracking_error=None), progress_to_message, progress_from_message),
        *(
            (Summary(3, outcome, "why", STATISTICS), summary_to_message, summary_from_message)
            for outcome in Outcome
        ),
        (Summary(3, Outcome.DONE, "", None), summary_to_message, summary_from_message),
        (
            Summary(
                3,
                Outcome.STOPPED,
                "",
                replace(STATISTICS, start_velocity_error=None, end_velocity_error=None),
            ),
            summary_to_message,
            summary_from_message,
        ),
    ],
    ids=lambda item: type(item).__name__ if is_dataclass(item) else "",
)
def test_a_report_survives_the_wire(report, to_message, from_message):
    message = to_message(report)
    assert from_message(type(message).FromString(message.SerializeToString())) == report


@pytest.mark.parametrize("state", ServoState)
def test_every_state_survives_the_wire(state):
    assert cycle_from_message(cycle_to_message(replace(CYCLE, state=state))).state is state


@pytest.mark.parametrize("fault", Fault)
def test_every_fault_survives_the_wire(fault):
    assert device_from_message(device_to_message(replace(DEVICE, fault=fault))).fault is fault


def samples_to_messages(samples):
    """Return one message for each instant."""
    columns = zip(
        samples.times.tolist(),
        samples.q.tolist(),
        samples.omega_body.tolist(),
        samples.alpha_body.tolist(),
        samples.position.tolist(),
        samples.velocity.tolist(),
        strict=True,
    )
    return [
        pb.MotionSample(
            path_time=time,
            orientation=quaternion(q),
            omega_body=vector(omega),
            alpha_body=vector(alpha),
            position=vector(position),
            velocity=vector(velocity),
        )
        for time, q, omega, alpha, position, velocity in columns
    ]


def test_samples_survive_the_wire():
    rng = np.random.default_rng(1)
    widths = {"q": 4, "omega_body": 3, "alpha_body": 3, "position": 3, "velocity": 3}
    samples = Samples(
        times=np.arange(5.0),
        **{name: rng.normal(size=(5, width)) for name, width in widths.items()},
    )
    arrived = samples_from_messages(samples_to_messages(samples))
    for field in fields(Samples):
        np.testing.assert_array_equal(getattr(arrived, field.name), getattr(samples, field.name))


def test_no_samples_keep_their_shape():
    assert samples_from_messages([]).q.shape == (0, 4)


def test_tracking_error_is_the_angle_to_the_feedback_whatever_its_sign():
    assert tracking_error(CYCLE) == pytest.approx(0.2, abs=1e-15)
    other = replace(CYCLE, feedback_q=tuple(-part for part in IDENTITY))
    assert tracking_error(other) == pytest.approx(0.2, abs=1e-15)
    assert tracking_error(BLIND) is None
