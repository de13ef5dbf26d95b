"""Fifty whole passes through `orientd serve rotctld`, as `rotctl` asks for them once a second.

They run in real time, ten rotators at once, each with a daemon and servos of its own: some 85
minutes for each of the two tests on two cores that do nothing else.  The emulated servos have
neither inertia nor wind, and one cycle in 0.1 s: the tests show where a rotator is sent, not how
well a motor follows.
"""

import contextlib
import queue
import shutil
import threading
import traceback

import numpy as np
import pytest
from antenna_station import PERIOD, Rotator, Station, least_time_off

sky = pytest.importorskip("reference.sky", reason="needs sgp4", exc_type=ImportError)
pytest.importorskip("dynamixel_sdk")

pytestmark = [
    pytest.mark.bench,
    pytest.mark.timeout(4 * 3600),
    pytest.mark.skipif(shutil.which("rotctl") is None, reason="rotctl of Hamlib is not installed"),
]

AT_ONCE = 10
TURNS = [(0.0, 360.0), (0.0, 450.0), (-180.0, 180.0)]
HEIGHTS = [(0.0, 90.0), (0.0, 180.0)]
SPEEDS = [3.0, 5.0, 8.0, 12.0, 20.0, 30.0]


def cases():
    """Yield a number, a pass and a rotator fifty times, as in ``test_passes.py``."""
    rng = np.random.default_rng(7)
    for number, one in enumerate(sky.passes(50)):
        turns, speed = TURNS[rng.integers(3)], SPEEDS[rng.integers(6)]
        yield number, one, Rotator(turns, HEIGHTS[int(number % 4 == 0)], speed)


def followed(folder, *, has_elements):
    """Follow every pass; return by number how, and the least time off target."""
    waiting, found, failed = queue.SimpleQueue(), {}, []
    for case in cases():
        waiting.put(case)
    starting = threading.Lock()

    def work():
        while not waiting.empty():
            number, one, rotator = waiting.get()
            try:
                with contextlib.ExitStack() as stack:
                    with starting:
                        station = stack.enter_context(Station(folder / str(number), rotator))
                    it = station.follow(one, has_elements)
            except Exception:  # noqa: BLE001 - the test shows whatever it is
                failed.append(f"{number}: {traceback.format_exc()}")
                continue
            found[number] = it, rotator

    threads = [threading.Thread(target=work) for _ in range(AT_ONCE)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert failed == []
    # Afterwards, as a search would hold up the clients that ask.
    return {number: (it, _least(number, it, rotator)) for number, (it, rotator) in found.items()}


def _least(number, it, rotator):
    least = least_time_off(it, rotator)
    print(f"{number:2} {rotator}: {it.setpoints:.2f} s, measured {it.measured:.2f}, least "
          f"{least:.2f}, {it.missed} cycles missed", flush=True)  # fmt: skip
    return least


@pytest.mark.parametrize("kind", ["setpoints", "measured"])
def test_known_passes_lose_hardly_more_than_the_least_time(known, kind):
    missed = []
    for number, (it, least) in sorted(known.items()):
        lost = getattr(it, kind)
        if lost > 1.05 * least + 2.0 * PERIOD:
            missed.append((number, lost, least, it.notes))
    assert missed == []


@pytest.fixture(scope="module")
def known(tmp_path_factory):
    """Return the passes of satellites whose orbital elements the server has."""
    return followed(tmp_path_factory.mktemp("known"), has_elements=True)


def test_unknown_passes_are_followed_again_after_every_turn_of_the_axes(tmp_path):
    """Without elements nothing is foreseen: the axes turn at most once all the way round."""
    missed = []
    rotators = {number: rotator for number, _, rotator in cases()}
    for number, (it, least) in sorted(followed(tmp_path, has_elements=False).items()):
        if it.setpoints > least + rotators[number].longest_turn:
            missed.append((number, it.setpoints, least, it.notes))
    assert missed == []
