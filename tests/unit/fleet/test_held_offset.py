"""The offset by which a recording shifts a daemon's times."""

from orientd_fleet.clocks import Offset
from orientd_fleet.recording import HeldOffset


def test_it_stays_while_it_may_be_right_and_moves_no_further_than_it_must():
    held = HeldOffset()
    assert held.take(Offset(1000, 100)) == Offset(1000, 100)
    assert held.take(Offset(1060, 80)) == Offset(1000, 140)
    assert held.take(Offset(1300, 50)) == Offset(1250, 100)
    assert held.ns == 1250
