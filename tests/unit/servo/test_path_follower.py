"""Where a follower is on a path of parts, record by record."""

from math import atan2, inf

import pytest
from rig import PERIOD, TERMS

from orientd.driver import ZERO
from orientd.floats import exp
from orientd.servo.path.path_follower import (
    PathFollower,
    PathPart,
)
from orientd.servo.path.segment import PathPoint
from orientd.stream.memory import SharedMemory
from orientd.stream.records import FINAL_WORD, JOINTS, NO_JOINTS

SPEED = 0.5  # rad/s about z
STEP = SPEED * PERIOD


def point(place, **changes):
    """Return the point *place* records along a steady turn about z."""
    steady = {
        "q": exp((0.0, 0.0, place * STEP)),
        "omega_body": (0.0, 0.0, SPEED),
        "alpha_body": ZERO,
        "position": ZERO,
        "velocity": ZERO,
    }
    return PathPoint(**{**steady, **changes})


@pytest.fixture
def ring():
    return SharedMemory.create(256, 256).path


@pytest.fixture
def follower(ring):
    return PathFollower(ring, PERIOD, TERMS)


def put(ring, *points):
    """Put points into the ring; return the index of the first."""
    first = ring.head
    for p in points:
        parts = (*p.q, *p.omega_body, *p.alpha_body, *p.position, *p.velocity)
        joints = (*p.joints, *NO_JOINTS)[:JOINTS], (*p.joint_velocities, *NO_JOINTS)[:JOINTS]
        ring.publish(*parts, *joints[0], *joints[1])
    return first


def lay(ring, places):
    """Put a piece of the turn into the ring; return the index of its first record."""
    return put(ring, *map(point, places))


def end(ring, final):
    """Say that *final* is the index of the last part's last record."""
    ring.words[FINAL_WORD] = final + 1


def begun(ring, follower, count=20, **fields):
    first = lay(ring, range(count))
    follower.begin(PathPart(1, first, TERMS, **fields))
    return first


def at(p):
    """Return how many records along the turn a point is."""
    return 2.0 * atan2(p.q[3], p.q[0]) / STEP


def ahead(follower, records):
    """Return how far along the turn the follower finds itself after so many records."""
    return at(follower.advance(records))


def chained(ring, follower):
    """Return the first records of three parts, left at the fourth record of each."""
    firsts = [begun(ring, follower, 6)]
    for number in (2, 3):
        first = lay(ring, range(4 * (number - 1), 4 * (number - 1) + 6))
        part = PathPart(number, first, TERMS, leave=firsts[-1] + 4)
        assert follower.splice(part) == ""
        firsts.append(first)
    return firsts


def test_several_legs_follow_one_another(ring, follower):
    firsts = chained(ring, follower)
    assert follower.records_left() == inf
    # 4 of each of two parts and 5 of the third.
    assert follower.reaches(13)
    assert not follower.reaches(14)
    for k in range(14):
        assert follower.peek_ahead(k) == point(k)
    assert follower.peek_ahead(14) is None
    end(ring, firsts[2] + 5)
    assert follower.reaches(14)
    for k in range(1, 14):
        assert ahead(follower, 1.0) == pytest.approx(k)
        assert follower.part.number == 1 + (k >= 4) + (k >= 8)
        assert bool(follower._ahead) == (k < 8)
        assert follower.reaches(13 - k)
    assert follower.is_at_end


def test_behind_the_end_nothing_is_peeked_at(ring, follower):
    begun(ring, follower, 8)
    end(ring, 5)
    assert follower.peek_ahead(5) == point(5)
    assert follower.peek_ahead(6) is None
    first = lay(ring, range(4, 9))
    assert follower.splice(PathPart(2, first, TERMS, leave=4, final=first + 2)) == ""
    assert follower.peek_ahead(6) == point(6)
    assert follower.peek_ahead(7) is None
