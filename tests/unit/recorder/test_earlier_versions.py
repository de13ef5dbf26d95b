"""Recordings of earlier versions are still read: see ``tests/data/recordings``."""

from pathlib import Path

import numpy as np
import pytest
from recorded import OFFSET_NS, RATE_HZ, moving

from orientd.recorder.earlier import cycles_of
from orientd.recorder.reader import load_recording
from orientd.stream.records import ServoState

FILES = sorted((Path(__file__).parents[2] / "data" / "recordings").glob("*.mcap"))
STEPS = {
    "path_fraction": 1e-9, "speed": 1e-9, "sent_q": 1e-10, "sent_omega_body": 1e-8,
    "sent_alpha_body": 1e-6, "sent_position": 1e-9, "measured_q": 1e-8,
    "measured_omega_body": 1e-6, "measured_position": 1e-7, "measured_joints": 1e-8,
    "sent_joints": 1e-8,
}  # fmt: skip
"""To which those versions rounded, in SI units."""


def recorded():
    """Return the cycles that each of the files was made of."""
    table = moving(120, joints=2)
    table["state"][:40] = ServoState.HOLDING
    table["state"][100:], table["fault"][100:] = ServoState.FAULT, 3
    table["flags"][:20] = table["feedback_time_ns"][:20] = 0
    return table


def test_there_are_files_of_each_version():
    assert {path.stem for path in FILES} == {"blocks", "blocks-without-sent-joints"}


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_every_cycle_of_an_earlier_version_is_read(path):
    recording, table = load_recording(path), recorded()
    assert recording.is_complete
    assert recording.rate_hz("arm") == RATE_HZ
    assert recording.offset_ns == OFFSET_NS
    found = recording.cycles["arm"]
    table["planned_q"] = np.nan
    if "without" in path.stem:
        table["sent_joints"] = np.nan
    for name in table.dtype.names:
        step = STEPS.get(name, 0.0)
        np.testing.assert_allclose(
            found[name], table[name], rtol=0, atol=0.501 * step, err_msg=name
        )


class Block:
    """A block that says of itself what it does not hold."""

    def __init__(self, count):
        self.count = count


def test_a_block_that_cannot_hold_its_cycles_takes_no_memory():
    with pytest.raises(ValueError, match="more cycles than it has bytes for"):
        cycles_of(Block(10**12), 1000)
