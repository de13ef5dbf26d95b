"""Passes that gpredict tracks with `orientd serve rotctld`: near the zenith, and through north.

To draw the picture of the guide again::

    pytest -m slow --basetemp=build/gpredict tests/system/test_gpredict.py
    python tests/system/gpredict_picture.py build/gpredict docs/how-to/pictures/antenna.png

The satellite has elements of its own, and the place is chosen so that the middle of a pass is due
at once.  gpredict sends positions on its own terms: up to half a second early or late, and none
while the measured direction is within its threshold.
"""

import time

import numpy as np
import pytest
from harness import DEVICE, DaemonProcess
from rotator import rotctld

from orientd import rotation
from orientd.client import connect
from orientd.protocol import control_pb2 as pb

pytest.importorskip("jeepney", reason="jeepney is not installed")
pytest.importorskip("sgp4", reason="sgp4 is not installed")

from desktop import missing
from gpredict import Wire, engaged
from reference.pass_due import pass_due

MISSING = missing("gpredict")
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(bool(MISSING), reason=f"not installed: {', '.join(MISSING)}"),
]

PASSES = {"zenith": {"elevation": 86.0, "heading": "north"},
          "north": {"elevation": 50.0, "heading": "east"}}  # fmt: skip
START, SECONDS = 20.0, 80.0
"""Of the watched part of a pass: s from the start of a test, and its length."""
PERIOD = 0.01
"""Of the device, s: a setpoint is for the end of its cycle."""


@pytest.fixture(scope="module")
def daemon(tmp_path_factory):
    """A device with the rate of a rotator: a busy machine lets it miss fewer cycles."""
    folder = tmp_path_factory.mktemp("daemon")
    with DaemonProcess(folder, rate_hz=1.0 / PERIOD) as process:
        process.stub.ReleaseLease(pb.ReleaseLeaseRequest(token=process.token))
        yield process


def vector(azimuth, elevation):
    azimuth, elevation = np.radians(azimuth), np.radians(elevation)
    level = np.cos(elevation)
    return np.stack([level * np.cos(azimuth), -level * np.sin(azimuth), np.sin(elevation)], -1)


def apart(due, times, orientations):
    """Return the angle from the satellite to where the x axis of a tool points, degrees."""
    pointed = rotation.rotate(orientations, [1.0, 0.0, 0.0])
    return np.degrees(np.linalg.norm(pointed - vector(*due.directions(times)), axis=-1))


def lost_time(cycle, cycles):
    """Return how long the machine did not run the servo during the motion of a cycle, s.

    The servo keeps the path of a planned motion, and loses this time on it.
    """
    first = next(one for one in cycles if one.motion == cycle.motion)
    return PERIOD * (cycle.missed - first.missed)


def told(what, angles):
    """Print and return the median, the 95 % quantile and the largest of angles in degrees."""
    found = np.median(angles), np.quantile(angles, 0.95), np.max(angles)
    print("{}: median {:.3f}, 95 % {:.3f}, largest {:.2f}".format(what, *found))
    return found


@pytest.mark.timeout(300)
@pytest.mark.parametrize("has_elements", [False, True], ids=["positions", "elements"])
@pytest.mark.parametrize("name", PASSES)
def test_a_device_stays_with_a_satellite(daemon, tmp_path, name, has_elements):
    begin = time.time() + START
    due = pass_due(begin + SECONDS / 2, **PASSES[name])
    known = tmp_path / "own.tle"
    known.write_text("TEST\n" + "\n".join(due.elements) + "\n")
    observer = ("--tle", known, "--observer", "{},{},{}".format(*due.place))
    cycles = []
    with (
        rotctld(daemon, *(observer if has_elements else ())) as client,
        Wire(client.port) as wire,
        connect(daemon.socket) as robot,
        engaged(tmp_path / "home", elements=due.elements, place=due.place, port=wire.port,
                cycle=200, threshold=0.1),
    ):  # fmt: skip
        for batch in robot.watch(DEVICE, rate_hz=5, decimation=2):
            cycles += batch
            if time.time() > begin + SECONDS:
                break
    offset = time.time() - time.monotonic()
    watched = [one for one in cycles if one.deadline_ns * 1e-9 + offset > begin]
    lost = np.array([lost_time(one, cycles) for one in watched]) * has_elements
    sent = np.array([one.deadline_ns for one in watched]) * 1e-9 + offset + PERIOD - lost
    seen = np.array([one.feedback_time_ns for one in watched]) * 1e-9 + offset - lost
    setpoints = apart(due, sent, np.array([one.q for one in watched]))
    measured = apart(due, seen, np.array([one.feedback_q for one in watched]))
    asked = np.array(wire.asked)
    np.savez(tmp_path / "record", name=name, has_elements=has_elements, asked=asked, sent=sent,
             q=np.array([one.q for one in watched]), error=setpoints,
             peak=begin + SECONDS / 2)  # fmt: skip
    print(f"\n{name}, elements {has_elements}: {len(asked)} positions in {SECONDS:.0f} s, "
          f"the longest gap {np.max(np.diff(asked[:, 0])):.2f} s")  # fmt: skip
    told("positions", np.degrees(np.linalg.norm(
        vector(*asked.T[1:]) - vector(*due.directions(asked[:, 0])), axis=-1)))  # fmt: skip
    median, most, _ = told("setpoints", setpoints)
    told("measured", measured)
    seconds = np.mean(setpoints > 0.5) * SECONDS
    print(f"lost {np.max(lost):.2f} s; over 0.5 degrees for {seconds:.1f} s")
    assert not [one for one in wire.answers if one.startswith("RPRT -")]
    assert median < (0.02 if has_elements else 0.15)
    assert most < (0.1 if has_elements else 0.4)
    assert seconds < 3.0
