"""The chain of the audit log, and what of a flood is written into it."""

import json

import pytest
from command_line import inside

from orientd.daemon import verify_audit
from orientd.daemon.access.audit import AuditLog
from orientd.daemon.access.repeats import BURST_BYTES, BYTES_PER_SECOND, FULL, WINDOW, Repeats
from orientd.errors import OrientdError


@pytest.fixture
def path(tmp_path, request):
    """Return the path of a log of 40 lines in three files, written by two daemons in turn."""
    path = tmp_path / getattr(request, "param", "audit.jsonl")
    for begin in (0, 20):
        log = AuditLog(path, most_bytes=3000, most_files=5)
        for number in range(begin, begin + 20):
            log.record(event="asked", number=number)
        log.close()
    assert len(list(tmp_path.iterdir())) >= 3
    return path


def change(path, edit):
    lines = path.read_bytes().splitlines(keepends=True)
    edit(lines)
    path.write_bytes(b"".join(lines))


@pytest.mark.parametrize("path", ["audit.jsonl", "audit[1-2]*.jsonl"], indirect=True)
def test_a_whole_log_is_whole_across_its_files_and_daemons(path):
    found = verify_audit(path)
    assert (found.lines, found.first, found.last, found.problems) == (40, 1, 40, [])


def test_a_log_goes_on_after_a_line_that_was_cut_short(path):
    path.write_bytes(path.read_bytes() + b'{"line": 41, "prev')
    log = AuditLog(path, most_bytes=3000, most_files=5)
    log.record(event="asked")
    log.close()
    assert verify_audit(path).problems == []


def test_what_was_forgotten_at_the_beginning_is_no_gap(path):
    max(path.parent.glob("audit.jsonl.*")).unlink()
    found = verify_audit(path)
    assert found.first > 1
    assert found.problems == []


@pytest.mark.parametrize(
    ("edit", "told"),
    [
        (lambda lines: lines.pop(3), "lines are missing before it: 1"),
        (lambda lines: lines.__setitem__(3, lines[3].replace(b"asked", b"tasks")), "not follow"),
        (lambda lines: lines.insert(3, lines[2]), "does not follow"),
        (lambda lines: lines.insert(3, b"{}\n"), "does not follow"),
        (lambda lines: lines.append(b"{}\n"), "no line of the log"),
        (lambda lines: lines.reverse(), "does not follow"),
    ],
    ids=["taken out", "changed", "twice", "put in", "appended", "reversed"],
)
def test_every_change_of_a_log_is_found(path, edit, told):
    change(path.with_name("audit.jsonl.1"), edit)
    assert any(told in problem for problem in verify_audit(path).problems) or told.startswith("no ")
    change(path, edit)
    assert any(told in problem for problem in verify_audit(path).problems)


def test_the_command_verifies_and_names_a_gap(path):
    done = inside("audit", "verify", path)
    assert (done.returncode, "40 lines in" in done.stdout) == (0, True)
    change(path, lambda lines: lines.pop(1))
    done = inside("audit", "verify", path, "--json")
    assert done.returncode == 1
    assert (
        "audit.jsonl, line 2: lines are missing before it: 1"
        in json.loads(done.stdout)["problems"][0]
    )


def test_a_log_that_is_not_there_is_an_error(tmp_path):
    with pytest.raises(OrientdError, match="cannot read"):
        verify_audit(tmp_path / "none")


def test_what_others_write_does_nothing_to_a_terminal(tmp_path):
    path = tmp_path / "audit.jsonl"
    log = AuditLog(path, most_bytes=3000, most_files=5)
    log.record(event="asked", text="\x1b[2J \x9b2J \u202e", name="für")
    log.close()
    (line,) = path.read_text().splitlines()
    assert line.isprintable()
    assert json.loads(line)["text"] == "\x1b[2J \x9b2J \u202e"


def flood(repeats, count, *, seconds=1.0, began=0.0, **fields):
    """Return what is written of *count* records over some time."""
    written = []
    for number in range(count):
        now = began + seconds * number / count
        record = {"time": now, "call": number, "identity": "user:7", **fields}
        written += repeats.due(now)
        written += repeats.take(
            {k: v(number) if callable(v) else v for k, v in record.items()}, now
        )
    return written


def test_the_same_again_and_again_is_counted_in_one_line():
    repeats = Repeats()
    origin = {"origin": lambda number: f"unix, process {number}"}
    written = flood(repeats, 10_000, event="refused", **origin)
    assert [record.get("times") for record in written] == [None] * FULL
    (counted,) = repeats.due(WINDOW)
    assert (counted["times"], counted["since"]) == (10_000 - FULL, pytest.approx(0.0005))
    assert repeats.due(1e9) == []


def test_ever_other_things_take_no_more_than_their_share():
    repeats = Repeats()
    hour = 3600.0
    written = flood(repeats, 40_000, seconds=hour, event="asked", text=lambda n: f"{n:0200}")
    written += repeats.due(hour, is_last=True)
    size = sum(len(json.dumps(record)) for record in written)
    assert size < 1.1 * (BURST_BYTES + BYTES_PER_SECOND * hour)
    assert sum(record.get("times", 1) for record in written) == 40_000


def test_somebodys_flood_leaves_the_lines_of_others_whole():
    repeats = Repeats()
    flood(repeats, 5000, event="asked", text=lambda n: f"{n:0200}")
    (one,) = repeats.take({"time": 1.0, "identity": "user:8", "event": "asked"}, 1.0)
    assert one["identity"] == "user:8"
