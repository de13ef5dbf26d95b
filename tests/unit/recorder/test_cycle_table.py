"""Cycles in a recording are those of the servo, to the quantum that is promised."""

import numpy as np
import pytest
from recorded import moving

from orientd.recorder.cycle_table import CYCLES, QUANTA, from_block, from_records, to_block
from orientd.stream import CYCLE_RECORD, unpack_cycle

PAIRS = (
    ("sent_q", "q"),
    ("sent_alpha_body", "alpha_body"),
    ("sent_position", "position"),
    ("measured_q", "feedback_q"),
    ("measured_joints", "joints"),
    ("sent_joints", "sent_joints"),
)


def test_a_row_is_the_servos_record_byte_for_byte():
    values = [*range(1, 13), *(0.5 * k for k in range(41))]
    record = CYCLE_RECORD.pack(*values)
    (row,), cycle = from_records(record), unpack_cycle(record[:48] + bytes(4) + record[52:])
    assert row["index"] == cycle.index
    assert row["feedback_time_ns"] == cycle.feedback_time_ns
    assert row["missed"] == cycle.missed
    for ours, theirs in PAIRS:
        assert tuple(row[ours]) == getattr(cycle, theirs)


@pytest.mark.parametrize("joints", [0, 3, 8])
def test_a_block_gives_back_every_number_to_half_its_quantum(joints):
    table = moving(256, joints=joints)
    back = from_block(to_block(table))
    for name in CYCLES.names:
        if name in QUANTA:
            np.testing.assert_allclose(back[name], table[name], rtol=0, atol=0.501 * QUANTA[name])
        else:
            np.testing.assert_array_equal(back[name], table[name])


def test_what_is_not_finite_is_kept_as_it_is():
    table = moving(20)
    table["measured_q"][7] = np.nan
    table["sent_alpha_body"][3, 1] = np.inf
    table["measured_joints"][5:, 2] = 0.25
    back = from_block(to_block(table))
    for name in ("measured_q", "sent_alpha_body", "measured_joints"):
        np.testing.assert_array_equal(back[name], table[name])


def test_cycles_without_feedback_have_no_time_of_it():
    table = moving(20)
    table["flags"][:10], table["feedback_time_ns"][:10] = 0, 0
    np.testing.assert_array_equal(
        from_block(to_block(table))["feedback_time_ns"], table["feedback_time_ns"]
    )


def test_a_block_of_nothing_is_nothing():
    assert len(from_block(to_block(np.zeros(0, CYCLES)))) == 0
