"""A plan made for a deployment, streamed through the driver on the emulated bus."""

import math

import numpy as np
import pytest

from orientd.errors import LimitError
from orientd.mechanism.routing import route
from orientd.rotation import angle, exp, multiply
from orientd_dynamixel.options import parse

OPTIONS = {
    "port": "virtual",
    "order": "ZY",
    "latency_ms": 4.0,
    "axes": [
        {"id": 1, "name": "pan", "limits_deg": [-270, 270], "velocity_deg": 120},
        {"id": 2, "name": "tilt", "limits_deg": [-180, 180], "velocity_deg": 120},
    ],
}


def test_planned_pass_over_the_pole_arrives_at_the_servos(rig):
    """From standing level, up, past the pole by two degrees, and down on the other side."""
    period = 0.005
    gimbal = parse({**OPTIONS, "max_deviation_deg": 3.0}).gimbal()
    times = np.arange(0, 6, period)
    way = np.deg2rad(150) * (10 * (times / 6) ** 3 - 15 * (times / 6) ** 4 + 6 * (times / 6) ** 5)
    miss = np.deg2rad(2)
    normal = np.array([0, -np.cos(miss), np.sin(miss)])
    q = multiply(exp(way[:, None] * normal), gimbal.orientation((0.0, 0.0)))
    path = route(gimbal, period, q, np.zeros((len(q), 3)), joints=(0.0, 0.0))
    (missed,) = [one for one in path.figures if one.name == "pointing error"]
    assert np.rad2deg(missed.value) <= 2.05
    assert any("pass near the pole, missing by at most 2.0" in line for line in path.notes)

    it = rig("ZY", axes=OPTIONS["axes"])
    it.start()
    worst = 0.0
    for row in path.joints.tolist():
        it.cycle(row)
        goals = np.array(it.goals()) - 2048 - np.array(row) * 4096 / math.tau
        worst = max(worst, float(np.max(np.abs(goals))))
    assert worst <= 0.5 + 1e-6
    for _ in range(80):
        feedback = it.cycle()
    assert it.driver._group.lost == 0
    assert np.rad2deg(float(angle(feedback.q, path.q[-1]))) < 0.07


def test_plan_says_what_it_refuses_by_the_axis_name():
    gimbal = parse(OPTIONS).gimbal()
    q = exp(np.outer(np.linspace(0, 5.5, 500), [0, 0, 1]))
    with pytest.raises(LimitError, match=r"(angle|velocity) of pan"):
        route(gimbal, 0.005, q, np.zeros((len(q), 3)), joints=(0.0, 0.0))
