"""The audit log, and what it tells of requests."""

import fcntl
import json
import threading
import time

import pytest
from reference.disk import Disk

from orientd.daemon.access import authorization
from orientd.daemon.access.audit import AuditLog
from orientd.protocol import control_pb2 as pb


def lines(path):
    return [json.loads(line) for line in path.read_text().splitlines()]


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
        "audit.jsonl.lock",
    ]
    kept = [
        record["number"]
        for name in ("audit.jsonl.2", "audit.jsonl.1", "audit.jsonl")
        for record in lines(tmp_path / name)
    ]
    assert kept == list(range(kept[0], 100))
    assert all(found.stat().st_size <= 1000 for found in tmp_path.iterdir())


def test_daemons_that_share_a_file_lose_nothing_when_all_put_it_aside(tmp_path):
    path = tmp_path / "audit.jsonl"
    logs = [AuditLog(path, most_bytes=2000, most_files=200) for _ in range(3)]
    for number in range(3000):
        logs[number % 3].record(number=number)
    for log in logs:
        log.close()
    kept = [record["number"] for found in tmp_path.glob("audit.jsonl*") for record in lines(found)]
    assert sorted(kept) == list(range(3000))


def test_a_line_that_a_full_disk_cut_leaves_the_next_one_whole(tmp_path):
    path = tmp_path / "audit.jsonl"
    path.write_text('{"number": 0}\n{"num')
    log = AuditLog(path, most_bytes=5000, most_files=2)
    log.record(number=1)
    log.close()
    first, cut, last = path.read_text().splitlines()
    assert (json.loads(first), cut, json.loads(last)["number"]) == ({"number": 0}, '{"num', 1)


@pytest.mark.parametrize("name", ["audit.jsonl", "audit.jsonl.lock"])
def test_a_link_to_a_file_of_the_user_is_not_written_to(tmp_path, caplog, name):
    precious = tmp_path / "thesis.txt"
    precious.write_text("precious")
    (tmp_path / name).symlink_to(precious)
    log = AuditLog(tmp_path / "audit.jsonl", most_bytes=5000, most_files=2)
    log.record(number=1)
    log.close()
    assert precious.read_text() == "precious"
    assert f"audit: cannot write to {tmp_path / 'audit.jsonl'}: " in caplog.text


def test_records_of_the_audit_log_are_on_the_disk_once_none_waits(tmp_path, monkeypatch):
    disk = Disk(monkeypatch, tmp_path)
    log = AuditLog(tmp_path / "audit.jsonl", most_bytes=2000, most_files=50)
    for number in range(100):
        log.record(number=number)
        if number % 10 == 0:
            time.sleep(0.01)
    log.close()
    left = disk.after_power_cut()
    assert len(left) > 3
    lines = b"".join(left.values()).splitlines()
    assert sorted(json.loads(line)["number"] for line in lines) == list(range(100))


def test_records_that_wait_at_the_end_are_on_the_disk_once_the_audit_log_is_closed(
    tmp_path, monkeypatch
):
    """Another daemon holds the file until the end has been asked for."""
    disk = Disk(monkeypatch, tmp_path)
    log = AuditLog(tmp_path / "audit.jsonl", most_bytes=2000, most_files=3)
    with (tmp_path / "audit.jsonl.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        for number in range(3):
            log.record(number=number)
        closing = threading.Thread(target=log.close)
        closing.start()
        time.sleep(0.1)
    closing.join()
    kept = disk.after_power_cut()["audit.jsonl"].splitlines()
    assert [json.loads(line)["number"] for line in kept] == [0, 1, 2]


def test_an_idle_audit_log_keeps_its_last_record_without_being_closed(tmp_path, monkeypatch):
    disk = Disk(monkeypatch, tmp_path)
    log = AuditLog(tmp_path / "audit.jsonl", most_bytes=2000, most_files=3)
    log.record(number=7)
    ends = time.monotonic() + 20.0
    while b'"number": 7' not in disk.after_power_cut().get("audit.jsonl", b""):
        assert time.monotonic() < ends
        time.sleep(0.0005)
    log.close()


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
    assert sounding == set(authorization.SECRETS)


@pytest.mark.parametrize(
    ("request_", "told"),
    [
        (pb.CommandRequest(lease_token="hush", device="arm"), {"device": "arm"}),
        (pb.RenewLeaseRequest(token="hush"), {}),
        (
            pb.TrackRequest(start=pb.TrackStart(lease_token="hush", device="arm")),
            {"device": "arm"},
        ),
        (
            pb.MoveRequest(lease_token="hush", queue=True, motion_id="m"),
            {"queue": True, "motion_id": "m"},
        ),
        (pb.AcquireLeaseRequest(holder="x" * 5000), {"holder": "x" * 200}),
    ],
    ids=["command", "renewal", "track", "move", "long text"],
)
def test_a_request_is_told_by_its_numbers_and_texts_without_its_token(request_, told):
    assert authorization.describe(request_) == told


def test_a_motion_is_told_by_its_file_its_size_and_a_digest():
    def told(motion, columns=b""):
        request = pb.MoveRequest(motion=motion, source="turn.yaml", columns=columns)
        told = authorization.describe(request)
        assert told.pop("source") == "turn.yaml"
        return told["motion"]

    first, again, other, columns = told(b"one"), told(b"one"), told(b"two"), told(b"one", b"more")
    assert (first["bytes"], columns["bytes"], len(first["sha256"])) == (3, 7, 64)
    assert first == again
    assert len({one["sha256"] for one in (first, other, columns)}) == 3
