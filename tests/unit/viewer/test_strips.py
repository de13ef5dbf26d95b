"""The strips of the last seconds."""

from dataclasses import replace

import numpy as np
import pytest
from fake_device import cycle

from orientd.floats import exp
from orientd.stream import CycleFlag
from orientd.viewer.strips import COUNT, SPAN, Strips

PERIOD_NS = 2_000_000


def at(index, **more):
    """A cycle of a device at 500 Hz."""
    lateness = more.pop("lateness_ns", 0)
    return replace(cycle(index, lateness_ns=lateness), deadline_ns=index * PERIOD_NS, **more)


def read(strips, name):
    times, values = strips.read()
    return times, values[name]


def test_the_latest_cycle_of_a_span_is_shown_however_many_come_after_it():
    strips = Strips()
    strips.add([at(k, lateness_ns=1_500_000 if k == 3 else 20_000) for k in range(25)])
    strips.add([at(k, lateness_ns=30_000) for k in range(25, 50)])
    _, lateness = read(strips, "lateness")
    assert lateness[-2:] == pytest.approx([1.5e-3, 30e-6])


def test_spans_in_which_nothing_was_heard_are_gaps():
    strips = Strips()
    strips.add([at(0)])
    strips.add([at(round(3 * SPAN * 1e9) // PERIOD_NS)])
    times, lateness = read(strips, "lateness")
    assert np.isfinite(lateness[-4:]).tolist() == [True, False, False, True]
    assert np.isnan(lateness[:-4]).all()
    assert times[-1] == 0.0
    assert times[0] == pytest.approx(-(COUNT - 1) * SPAN)


def test_batches_make_the_same_strips_as_one_by_one():
    generator = np.random.default_rng(2)
    cycles = [
        at(
            k,
            omega_body=tuple(generator.normal(size=3)),
            alpha_body=tuple(generator.normal(size=3)),
        )
        for k in range(400)
    ]
    together, singly = Strips(), Strips()
    together.add(cycles)
    for one in cycles:
        singly.add([one])
    for name, strip in together.read()[1].items():
        assert np.array_equal(strip, singly.read()[1][name], equal_nan=True), name
    speeds = [np.linalg.norm(one.omega_body) for one in cycles]
    assert np.nanmax(together.read()[1]["velocity"]) == pytest.approx(max(speeds))


def test_tracking_is_against_what_was_sent_a_lead_ago():
    lead = 10
    strips = Strips(lead)
    turn = [exp((0.0, 0.0, 0.002 * k)) for k in range(60)]
    flags = CycleFlag.FEEDBACK | CycleFlag.WRITTEN
    strips.add(
        [
            at(k, q=turn[k], feedback_q=turn[max(0, k - lead)], flags=flags)
            for k in range(60)
        ]
    )  # fmt: skip
    _, error = read(strips, "tracking_error")
    assert error[-1] == pytest.approx(0.0, abs=1e-12)


def test_without_feedback_nothing_is_claimed_of_it():
    strips = Strips()
    strips.add([at(0, flags=CycleFlag.WRITTEN)])
    _, values = strips.read()
    assert np.isnan(values["tracking_error"]).all()
    assert np.isnan(values["velocity_measured"]).all()


def test_another_servo_with_another_clock_begins_anew():
    strips = Strips()
    strips.add([at(100_000)])
    strips.add([at(3, lateness_ns=40_000)])
    _, lateness = read(strips, "lateness")
    assert lateness[-1] == pytest.approx(40e-6)
    assert np.isnan(lateness[:-1]).all()
