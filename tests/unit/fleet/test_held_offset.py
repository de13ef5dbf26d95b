"""The offset by which a recording shifts a daemon's times."""

from orientd.client.daemon_clock import Offset
from orientd_fleet.recording import kept_offset


def test_it_stays_while_it_may_be_right_and_moves_no_further_than_it_must():
    first = kept_offset(None, Offset(1000, 100))
    assert first == Offset(1000, 100)
    second = kept_offset(first, Offset(1060, 80))
    assert second == Offset(1000, 140)
    assert kept_offset(second, Offset(1300, 50)) == Offset(1250, 100)
