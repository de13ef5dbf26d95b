"""Lines that are targets, and lines that are none."""

import json
import math
import os
import random
import time

import pytest

from orientd.cli.commands.track import _Lines
from orientd.client.pointing import Pointing
from orientd.protocol import control_pb2 as pb
from orientd.protocol.targets import target_from_message

CASES = int(os.environ.get("ORIENTD_CASES", "60"))
GOOD = b'{"rotation_vector": [0, 0, 0.1]}'


class Session(Pointing):
    """A session of which only the targets are kept."""

    report = pb.TrackResponse(q=pb.Quaternion(w=1.0))

    def __init__(self):
        super().__init__(None, "")
        self.targets = []

    def hand_over(self, message):
        self.targets.append(message)


def read(*lines, time_to_live=0.5):
    reader, session = _Lines(time_to_live), Session()
    reader.feed([line + b"\n" for line in lines], session)
    return session.targets, reader


BAD = [
    (b"null", "expected a JSON object, got None"),
    (b"[1, 2]", "expected a JSON object, got [1, 2]"),
    (b'{"rotation_vector": [0, 0, 0', "expected a JSON object: "),
    (b'{"rotation_vector": [0, 0, NaN]}', "expected finite numbers, got NaN"),
    (b'{"rotation_vector": [0, 0, Infinity]}', "expected finite numbers, got Infinity"),
    (b'{"rotation_vector": [0, 0, 1e999]}', "rotation_vector"),
    (b'{"rotation_vector": [0, 0, null]}', "rotation_vector"),
    (b'{"quaternion": {"w": 0, "x": 0, "y": 0, "z": 0}}', "norm"),
    (b'{"quaternion": {"w": 1.01, "x": 0, "y": 0, "z": 0}}', "norm"),
    (b'{"quaternion": {"w": 0.9985, "x": 0, "y": 0, "z": 0}}', "norm"),
    (
        b'{"rotation_vector": [0, 0, 1], "ttl": 1}',
        "unknown key 'ttl'; did you mean 'time_to_live'?",
    ),
    (
        b'{"rotation_vectr": [0, 0, 1]}',
        "unknown key 'rotation_vectr'; did you mean 'rotation_vector'?",
    ),
    (b'{"rotation_vector": [0, 0, 1], "angular_velocity": [0, 1e999, 0]}', "angular_velocity"),
    (b'{"rotation_vector": [0, 0, 1], "angular_velocity": "fast"}', "angular_velocity"),
    (b'{"rotation_vector": [0, 0, 1], "position": [0, 1]}', "position"),
    (b'{"rotation_vector": [0, 0, 1], "time_to_live": -1}', "time_to_live"),
    (b'{"rotation_vector": [0, 0, 1], "time_to_live": "long"}', "time_to_live"),
    (b'{"rotation_vector": [0, 0, 1], "time_ns": 1.5}', "time_ns"),
    (b'{"rotation_vector": [0, 0, 1], "time_ns": ' + b"9" * 40 + b"}", ""),
    (b'{"rotation_vector": [0, 0, 1], "velocity_frame": "moon"}', "velocity_frame"),
    (b'{"point": [1, 0]}', "point: expected three numbers"),
    (b'{"point": [1, 0, 0], "velocty": [0, 1, 0]}', "did you mean 'velocity'?"),
    (b'{"base": {"quaternion": 1}}', "q_world_base.quaternion"),
    (b'{"base": {"rotation_vector": [0, 0, 0]}, "time_to_live": 0}', "time_to_live"),
    (b"{}", ""),
    (b"\xff\xfe\xfa", ""),
    (b"[" * 100_000, ""),
]


@pytest.mark.parametrize(("line", "word"), BAD, ids=[str(line[:60]) for line, _ in BAD])
def test_a_bad_line_is_named_and_the_next_one_counts(line, word, capsys):
    targets, reader = read(GOOD, line, GOOD)
    assert (len(targets), reader.bad) == (2, 1)
    (said,) = capsys.readouterr().err.splitlines()
    assert said.startswith("orientd: line 2: ")
    assert word in said


def test_a_flood_of_bad_lines_is_named_ten_times_and_counted(capsys):
    targets, reader = read(*[b"null"] * 500, GOOD)
    assert (len(targets), reader.bad) == (1, 500)
    said = capsys.readouterr().err.splitlines()
    assert len(said) == 10
    assert said[-1].endswith("further ones are only counted")


def test_blank_lines_are_no_targets_and_no_mistakes(capsys):
    targets, reader = read(b"", GOOD, b"  ")
    assert (len(targets), reader.bad, capsys.readouterr().err) == (1, 0, "")


def test_what_a_line_says_is_taken_and_the_rest_is_the_option():
    now_ns = time.monotonic_ns()
    line = {"rotation_vector": [0, 0, 1], "time_to_live": 2, "position": [1, 2, 3]}
    own, other = read(json.dumps({**line, "time_ns": now_ns}).encode(), GOOD, time_to_live=0.7)[0]
    assert (own.time_to_live, own.time_ns, own.position.z) == (2.0, now_ns, 3.0)
    assert other.time_to_live == 0.7


def random_line(rng):
    """Return a line cut, spoilt or whole."""
    numbers = [0, 0.3, -1.0, 7, math.nan, math.inf, 1e308, None, "1", [], True]
    mapping = {
        rng.choice(["rotation_vector", "quaternion", "euler", "matrix", "turn"]): rng.choice(
            [[rng.choice(numbers) for _ in range(rng.randrange(5))], rng.choice(numbers), {}]
        )
        if rng.random() < 0.6
        else [0, 0, rng.uniform(-1.0, 1.0)]
    }
    for key in ("time_ns", "time_to_live", "position", "angular_velocity", "velocity_frame", "ttl"):
        if rng.random() < 0.15:
            mapping[key] = rng.choice([*numbers, [0.0, 0.1, 0.2], "world"])
    line = json.dumps(mapping).encode()
    if rng.random() < 0.2:
        line = line[: rng.randrange(1, len(line))]
    if rng.random() < 0.1:
        at = rng.randrange(len(line))
        line = line[:at] + bytes([rng.randrange(256)]) + line[at + 1 :]
    return line.replace(b"\n", b"")


@pytest.mark.parametrize("seed", range(CASES))
def test_every_line_is_a_target_or_is_counted(seed):
    rng = random.Random(seed)
    lines = [random_line(rng) for _ in range(20)]
    targets, reader = read(*lines, GOOD)
    assert len(targets) + reader.bad == 21 - sum(not line.strip() for line in lines)
    for target in targets:
        target_from_message(target, target.time_ns)


def test_lines_look_at_points_from_a_moving_base():
    turned = {"rotation_vector": [0, 0, 0.5 * math.pi]}
    base = json.dumps({"base": turned, "angular_velocity": [0, 0, 0]}).encode()
    targets, reader = read(base, b'{"point": [0, 5, 0], "roll": 0}')
    assert (len(targets), reader.bad) == (1, 0)
    assert abs(targets[0].orientation.w) == pytest.approx(1.0)
