"""Helpers for the messages that the daemon reports with."""

import numpy as np
import pytest

from orientd.cli import output
from orientd.errors import Fault
from orientd.protocol import control_pb2 as pb
from orientd.protocol import plain
from orientd.protocol.reports import samples, word
from orientd.protocol.values import quaternion, vector


@pytest.mark.parametrize(
    ("message", "field", "expected"),
    [
        (pb.MoveSummary(outcome=pb.OUTCOME_UNSETTLED), "outcome", "unsettled"),
        (pb.DeviceReport(state=pb.STATE_HOLDING), "state", "holding"),
        (pb.DeviceReport(fault=pb.FAULT_LINK_LOST), "fault", "link_lost"),
        (pb.DeviceReport(), "fault", "none"),
        (pb.Event(kind=pb.EVENT_KIND_MOTION_DONE), "kind", "motion_done"),
        (pb.DeviceReport(state=99), "state", "99"),
    ],
)
def test_an_enumeration_is_read_as_a_word(message, field, expected):
    assert word(message, field) == expected


@pytest.mark.parametrize("fault", Fault)
def test_every_fault_has_its_number_in_a_message(fault):
    assert word(pb.DeviceReport(fault=fault.value), "fault") == fault.name.lower()


def test_a_message_is_plain_values_with_everything_said():
    found = plain(
        pb.DeviceReport(
            name="arm",
            limits=pb.Limits(velocity=2.0),
            cycle=pb.Cycle(
                index=2**40, q=quaternion((1.0, 0.0, 0.0, 0.0)), omega_body=vector((0.0, 1.0, 2.0))
            ),
            health=[pb.PartHealth(name="yaw", voltage=12.0)],
        )
    )  # fmt: skip
    assert found["name"] == "arm"
    assert found["servo_pid"] is None
    assert found["limits"]["velocity"] == 2.0
    assert found["limits"]["jerk"] is None
    assert found["cycle"]["index"] == 2**40
    assert found["cycle"]["q"] == {"w": 1.0, "x": 0.0, "y": 0.0, "z": 0.0}
    assert found["cycle"]["omega_body"] == [0.0, 1.0, 2.0]
    assert found["cycle"]["feedback_q"] is None
    assert found["health"] == [
        {
            "name": "yaw", "age": 0.0, "is_stale": False, "voltage": 12.0, "temperature": None,
            "current": None, "warning": "",
        }
    ]  # fmt: skip


def test_a_number_that_json_has_no_word_for_is_null():
    assert output.plain({"limits": pb.Limits(velocity=float("inf"))})["limits"]["velocity"] is None


def test_samples_are_read_as_arrays():
    rng = np.random.default_rng(1)
    rows = rng.normal(size=(5, 16))
    columns = pb.MotionColumns(
        path_times=range(5),
        q=rows[:, :4].ravel(),
        omega_body=rows[:, 4:7].ravel(),
        alpha_body=rows[:, 7:10].ravel(),
        position=rows[:, 10:13].ravel(),
        velocity=rows[:, 13:].ravel(),
    )
    found = samples(pb.Plan(samples=columns))
    table = [found.q, found.omega_body, found.alpha_body, found.position, found.velocity]
    np.testing.assert_array_equal(np.hstack(table), rows)
    np.testing.assert_array_equal(found.times, np.arange(5.0))
