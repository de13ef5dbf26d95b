"""How old what a page shows is: of the daemon or of its servo, whichever is older."""

import pytest

from orientd.viewer.watcher import Sight

NOW = 100.0


@pytest.mark.parametrize(
    ("seen", "alive", "age", "trouble"),
    [
        (99.9, 99.9, 0.1, ""),
        (97.0, 96.9, 3.1, "no word from the daemon for 3 s"),
        (99.9, 97.0, 3.0, "no cycle of its servo for 3 s"),
        (100.2, 100.1, 0.0, ""),
    ],
)
def test_the_older_one_of_daemon_and_servo_counts(seen, alive, age, trouble):
    sight = Sight(seen=seen, alive=alive)
    assert sight.age(NOW) == pytest.approx(age)
    assert sight.trouble(NOW) == trouble
