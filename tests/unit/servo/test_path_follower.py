"""Where a follower is on a path of parts, record by record."""

import struct
from dataclasses import replace
from math import atan2, inf, sqrt

import pytest
from rig import PERIOD, TERMS

from orientd.driver import ZERO
from orientd.floats import exp
from orientd.servo.path.path_follower import (
    MOST_LEGS,
    PathFollower,
    PathPart,
    StarvedError,
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


def test_a_record_that_is_written_and_not_published_is_not_peeked_at(ring, follower):
    lay(ring, range(3))
    record = ring.read_bytes(2)
    ring.put([struct.pack("Q", 3) + record[8:]], 3)
    assert ring.read(3) is not None
    assert follower.peek(3) is None
    ring.advance(4)
    assert follower.peek(3) == point(2)


@pytest.mark.parametrize("part", range(4))
def test_a_path_is_of_unit_quaternions_alone(ring, follower, part):
    q = tuple(0.5 if k != part else -0.5 for k in range(4))
    put(ring, point(0, q=q))
    for excess in (0.9e-6, 1.1e-6):
        put(ring, point(0, q=tuple(sqrt(c * c + (k == part) * excess) for k, c in enumerate(q))))
    for first in (0, 1):
        follower.begin(PathPart(1, first, TERMS))
    with pytest.raises(StarvedError, match="path record 2 is not an orientation"):
        follower.begin(PathPart(1, 2, TERMS))


def test_a_record_that_is_being_published_is_read_again(ring, follower, monkeypatch):
    lay(ring, range(2))
    read, misses = ring.read, [2]

    def torn(index):
        misses[0] -= 1
        return None if misses[0] >= 0 else read(index)

    monkeypatch.setattr(type(ring), "read", lambda _, index: torn(index))
    assert follower.peek(1) == point(1)
    misses[0] = 3
    assert follower.peek(1) is None


def test_without_an_end_the_path_is_starved_of_what_is_not_there(ring, follower):
    begun(ring, follower, 3)
    ahead(follower, 1.0)
    assert ahead(follower, 1.0) == pytest.approx(2.0)
    with pytest.raises(StarvedError, match="path record 3 is not"):
        follower.advance(0.5)
    with pytest.raises(StarvedError, match="path record 3 is not"):
        follower.advance(1.0)
    assert follower.index == 2


def test_an_end_of_a_motion_before_does_not_count(ring, follower):
    lay(ring, range(3))
    end(ring, 2)
    begun(ring, follower, 4)
    assert follower.records_left() == inf
    assert ahead(follower, 1.0) == pytest.approx(1.0)
    assert not follower.is_at_end
    end(ring, 6)
    assert follower.records_left() == 2


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


def test_what_has_other_limits_is_not_peeked_at(ring, follower):
    begun(ring, follower, 8)
    first = lay(ring, range(4, 9))
    assert follower.splice(PathPart(2, first, replace(TERMS, jerk=1.0), leave=4)) == ""
    assert follower.peek_ahead(3) == point(3)
    assert follower.peek_ahead(4) is None
    assert follower.splice(PathPart(3, first, replace(TERMS, brake_rate=9.0), leave=4)) == ""
    assert follower.peek_ahead(4) == point(4)


def test_a_splice_on_a_leg_ahead_keeps_those_before_it(ring, follower):
    firsts = chained(ring, follower)
    first = lay(ring, range(6, 9))
    assert follower.splice(PathPart(4, first, TERMS, leave=firsts[1] + 2)) == ""
    numbers = []
    for _ in range(8):
        ahead(follower, 1.0)
        numbers.append(follower.part.number)
    assert numbers == [1, 1, 1, 2, 2, 4, 4, 4]


def test_a_record_beyond_where_its_leg_is_left_is_not_on_the_path(ring, follower):
    firsts = chained(ring, follower)
    first = lay(ring, range(5, 9))
    revision = follower.revision
    for leave in (5, firsts[1] + 5):
        problem = follower.splice(PathPart(4, first, TERMS, leave=leave))
        assert problem == f"record {leave} is not on the path any more"
    assert follower.revision == revision
    # Where the part is left by another it may be left for this one, too.
    first = lay(ring, range(4, 9))
    assert follower.splice(PathPart(4, first, TERMS, leave=4)) == ""


def test_a_record_that_is_not_there_cannot_be_joined(ring, follower):
    begun(ring, follower, 4)
    assert follower.splice(PathPart(2, 9, TERMS, leave=2)) == "path record 9 is not in the ring"
    assert follower.splice(PathPart(2, 2, TERMS, leave=7)) == "path record 7 is not in the ring"
    assert not follower._ahead
    assert follower.revision == 1


def test_there_is_room_for_a_number_of_legs(ring, follower):
    begun(ring, follower, 3)
    leave = 1
    for number in range(MOST_LEGS):
        first = lay(ring, range(number + 1, number + 4))
        assert follower.splice(PathPart(number, first, TERMS, leave=leave)) == ""
        leave = first + 1
    first = lay(ring, range(MOST_LEGS + 1, MOST_LEGS + 4))
    assert follower.splice(PathPart(99, first, TERMS, leave=leave)) == (
        f"there are {MOST_LEGS} motions ahead already"
    )
    assert MOST_LEGS == 16


def along(axis, value):
    return tuple(value if k == axis else 0.0 for k in range(3))


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize(
    ("name", "most", "words", "unit"),
    [
        ("omega_body", 1e-6 * (1 + SPEED), "angular velocity", "rad/s"),
        ("alpha_body", 1e-6, "angular acceleration", "rad/s^2"),
        ("position", 1e-9, "position", "m"),
        ("velocity", 1e-6, "velocity", "m/s"),
    ],
)
def test_paths_are_joined_where_they_agree(ring, follower, name, most, words, unit, axis):
    lay(ring, range(3))
    follower.begin(PathPart(1, 0, TERMS))
    here = point(2)
    for share, is_joined in ((0.9, True), (-1.1, False)):
        gap = along(axis, share * most)
        value = tuple(a + b for a, b in zip(getattr(here, name), gap, strict=True))
        first = put(ring, here._replace(**{name: value}))
        problem = follower.splice(PathPart(2, first, TERMS, leave=2))
        assert (problem == "") is is_joined
    assert problem == f"the {words} of the two paths differs by {1.1 * most:.3g} {unit}"


def test_orientations_are_joined_up_to_a_nanoradian_and_their_sign(ring, follower):
    lay(ring, range(3))
    follower.begin(PathPart(1, 0, TERMS))
    q = exp((0.0, 0.0, 2 * STEP + 0.9e-9))
    first = put(ring, point(2, q=tuple(-part for part in q)))
    assert follower.splice(PathPart(2, first, TERMS, leave=2)) == ""
    first = put(ring, point(2, q=exp((0.0, 0.0, 2 * STEP + 1.1e-9))))
    problem = follower.splice(PathPart(2, first, TERMS, leave=2))
    assert problem == "the orientation of the two paths differs by 1.1e-09 rad"


def test_what_is_not_a_number_is_not_joined(ring, follower):
    lay(ring, range(3))
    follower.begin(PathPart(1, 0, TERMS))
    first = put(ring, point(2, velocity=(float("nan"), 0.0, 0.0)))
    assert "velocity" in follower.splice(PathPart(2, first, TERMS, leave=2))
