"""The strips of the last seconds."""

from dataclasses import replace

import numpy as np
import pytest
from fake_device import cycle

from orientd.floats import exp
from orientd.stream.records import CycleFlag
from orientd.viewer.charts import COLUMNS, COUNT, SPAN, Strips

PERIOD_NS = 2_000_000


def at(index, **more):
    """A cycle of a device at 500 Hz."""
    lateness = more.pop("lateness_ns", 0)
    return replace(cycle(index, lateness_ns=lateness), deadline_ns=index * PERIOD_NS, **more)


def read(strips, name):
    return [row[1 + COLUMNS.index(name)] for row in strips.since(0)]


def test_the_latest_cycle_of_a_span_is_shown_however_many_come_after_it():
    strips = Strips()
    strips.add([at(k, lateness_ns=1_500_000 if k == 3 else 20_000) for k in range(25)])
    strips.add([at(k, lateness_ns=30_000) for k in range(25, 50)])
    lateness = read(strips, "lateness")
    assert lateness[-2:] == pytest.approx([1.5e-3, 30e-6])


def test_spans_in_which_nothing_was_heard_have_no_row():
    strips = Strips()
    strips.add([at(0)])
    strips.add([at(round(3 * SPAN * 1e9) // PERIOD_NS)])
    assert [row[0] for row in strips.since(0)] == [0, 3]
    assert [row[0] for row in strips.since(1)] == [3]


def test_the_last_ten_seconds_are_kept():
    strips = Strips()
    for k in range(COUNT + 20):
        strips.add([at(round(k * SPAN * 1e9) // PERIOD_NS)])
    assert len(strips.since(0)) == COUNT


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
    assert together.since(0) == singly.since(0)
    speeds = [np.linalg.norm(one.omega_body) for one in cycles]
    assert max(read(together, "velocity")) == pytest.approx(max(speeds))


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
    error = read(strips, "tracking_error")
    assert error[-1] == pytest.approx(0.0, abs=1e-12)


def test_without_feedback_nothing_is_claimed_of_it():
    strips = Strips()
    strips.add([at(0, flags=CycleFlag.WRITTEN)])
    assert read(strips, "tracking_error") == [None]
    assert read(strips, "velocity_measured") == [None]


def test_another_servo_with_another_clock_begins_anew():
    strips = Strips()
    strips.add([at(100_000)])
    strips.add([at(3, lateness_ns=40_000)])
    assert read(strips, "lateness") == [pytest.approx(40e-6)]
