"""The audit log and what it tells of requests, and how much somebody may ask for."""

import hashlib
import json

import pytest

from orientd.daemon.access import request_text
from orientd.daemon.access.audit import AuditLog
from orientd.daemon.access.authorization import legible
from orientd.daemon.access.throttle import BURST, CONNECTIONS, Throttle
from orientd.errors import RequestError
from orientd.rpc import control_pb2 as pb


def lines(path):
    return [json.loads(line) for line in path.read_text().splitlines()]


def test_records_are_appended(tmp_path):
    path = tmp_path / "state" / "audit.jsonl"
    for number in range(2):
        log = AuditLog(path, most_bytes=100_000, most_files=2)
        log.record(event="asked", number=number, text="newline\nand ü")
        log.close()
    assert [record["number"] for record in lines(path)] == [0, 1]
    assert path.stat().st_mode & 0o777 == 0o600
    assert lines(path)[0]["time"].endswith("Z")


def test_a_large_file_is_put_aside_and_the_oldest_forgotten(tmp_path):
    path = tmp_path / "audit.jsonl"
    log = AuditLog(path, most_bytes=1000, most_files=2)
    for number in range(100):
        log.record(number=number, text="x" * 100)
    log.close()
    assert sorted(found.name for found in tmp_path.iterdir()) == [
        "audit.jsonl",
        "audit.jsonl.1",
        "audit.jsonl.2",
    ]
    kept = [
        record["number"]
        for name in ("audit.jsonl.2", "audit.jsonl.1", "audit.jsonl")
        for record in lines(tmp_path / name)
    ]
    assert kept == list(range(kept[0], 100))
    assert all(found.stat().st_size <= 1000 for found in tmp_path.iterdir())


def test_two_daemons_share_a_file_and_lose_nothing(tmp_path):
    path = tmp_path / "audit.jsonl"
    logs = [AuditLog(path, most_bytes=5000, most_files=100) for _ in range(2)]
    for number in range(300):
        logs[number % 2].record(number=number)
    for log in logs:
        log.close()
    kept = [record["number"] for found in tmp_path.iterdir() for record in lines(found)]
    assert sorted(kept) == list(range(300))


def test_a_disk_that_fails_stops_nobody(tmp_path, caplog):
    path = tmp_path / "file" / "audit.jsonl"
    path.parent.write_text("no folder")
    log = AuditLog(path, most_bytes=1000, most_files=2)
    for _ in range(3):
        log.record(event="asked")
    log.close()
    assert [record.message for record in caplog.records if "audit" in record.message] == [
        f"audit: cannot write to {path}: [Errno 17] File exists: '{path.parent}'"
    ]


def messages(descriptor=pb.DESCRIPTOR):
    return descriptor.message_types_by_name.values()


def test_every_field_that_sounds_like_a_secret_is_one():
    sounding = {
        field.name
        for message in messages()
        for field in message.fields
        if any(word in field.name for word in ("token", "secret", "password"))
    }
    assert sounding == set(request_text.SECRETS)


@pytest.mark.parametrize(
    "request_",
    [
        pb.EnableRequest(lease_token="hush", device="arm"),
        pb.RenewLeaseRequest(token="hush"),
        pb.TrackRequest(start=pb.TrackStart(lease_token="hush")),
        pb.MoveRequest(lease_token="hush", motion=pb.MotionRequest(keyframes=[{}] * 3)),
        pb.MoveRequest(lease_token="hush", motion=pb.MotionRequest(keyframes=[{}] * 5000)),
    ],
    ids=["command", "renewal", "track", "move", "long move"],
)
def test_a_request_is_told_without_its_token(request_):
    assert request_text.token(request_) == "hush"
    assert "hush" not in json.dumps(request_text.describe(request_))


def test_a_long_request_is_told_by_its_digest():
    request = pb.MoveRequest(device="arm", motion=pb.MotionRequest(keyframes=[{}] * 5000))
    told = request_text.describe(request)
    content = request.SerializeToString(deterministic=True)
    assert told == {
        "bytes": len(content),
        "sha256": hashlib.sha256(content).hexdigest(),
        "device": "arm",
        "keyframes": 5000,
    }


class Somebody:
    pass


def test_a_request_with_an_impossible_time_is_told_by_its_digest():
    request = pb.MoveRequest(device="arm", lease_token="secret")
    request.start_time.nanos = -1
    told = request_text.describe(request)
    assert told["device"] == "arm"
    assert "sha256" in told
    assert "secret" not in json.dumps(told)


def test_bytes_that_are_no_request_are_told_in_one_line():
    read = legible(pb.StopRequest.FromString)
    assert read(b"") == pb.StopRequest()
    found = read(b"\xff\xff")
    assert isinstance(found, RequestError)
    assert "StopRequest" in found.problem
    assert "\n" not in found.problem
    assert legible(None) is None


def test_requests_are_counted_over_time_by_connection():
    throttle = Throttle(per_second=10, at_once=1)
    one, other = Somebody(), Somebody()
    burst = round(BURST * 10)
    assert sum(throttle.takes(one, "ana", 5.0) for _ in range(100)) == burst
    assert throttle.takes(other, "ana", 5.0)
    assert sum(throttle.takes(one, "ana", 6.0) for _ in range(100)) == 10
    assert sum(throttle.takes(one, "ana", 1e6) for _ in range(100)) == burst


def test_many_connections_of_one_identity_get_a_few_times_as_much():
    throttle = Throttle(per_second=10, at_once=1)
    crowd = [Somebody() for _ in range(50)]
    taken = sum(throttle.takes(one, "ana", 5.0) for one in crowd for _ in range(100))
    assert taken == CONNECTIONS * round(BURST * 10)
    # Who commands is not kept out by a crowd of the same user, nor is another user.
    assert throttle.takes(Somebody(), "ana", 5.0, has_lease=True)
    assert throttle.takes(Somebody(), "ben", 5.0)


def test_calls_are_counted_at_one_time_by_identity():
    throttle = Throttle(per_second=10, at_once=2)
    assert [throttle.begins("ana") for _ in range(3)] == [True, True, False]
    assert throttle.begins("ben")
    assert throttle.begins("ana", has_lease=True)
    throttle.ends("ana")
    throttle.ends("ana")
    assert throttle.begins("ana")
