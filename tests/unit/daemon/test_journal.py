"""The journal keeps the newest events, as many as it has room for."""

import threading
from types import SimpleNamespace

import pytest

from orientd.daemon.device import DeviceEvent, EventKind
from orientd.daemon.observe import journal as module
from orientd.daemon.observe.journal import Journal
from orientd.protocol import control_pb2 as pb


def kept_of(texts, *, room, monkeypatch, seconds=60.0, device="arm"):
    """Return the texts that are kept of these, said 1 s after another."""
    monkeypatch.setattr(module, "KEPT_BYTES", room)
    journal = Journal(kept=seconds)
    for number, text in enumerate(texts):
        journal.on_event(DeviceEvent("arm", EventKind.WARNING, text, number * 10**9))
    journal.close()
    return [pb.Event.FromString(event).text for event in journal.kept(device, 0)]


def test_events_are_kept_as_they_were(monkeypatch):
    texts = [str(number) * (1 + 7 * number) for number in range(40)]
    assert kept_of(texts, room=100_000, monkeypatch=monkeypatch) == texts
    assert kept_of(texts, room=100_000, monkeypatch=monkeypatch, device="leg") == []


@pytest.mark.parametrize("room", [200, 333, 1000])
def test_the_newest_are_kept_where_there_is_no_room_for_all(monkeypatch, room):
    texts = [f"{number:0{30 + number % 7}}" for number in range(100)]
    kept = kept_of(texts, room=room, monkeypatch=monkeypatch)
    assert kept == texts[-len(kept) :]
    assert room / 70 < len(kept) < room / 30


def test_old_ones_are_forgotten(monkeypatch):
    texts = [str(number) for number in range(100)]
    assert kept_of(texts, room=10**6, monkeypatch=monkeypatch, seconds=9.5) == texts[-10:]


def test_one_that_there_is_no_room_for_is_kept_in_any_case(monkeypatch):
    texts = ["a", "b" * 5000, "c"]
    assert kept_of(texts[:2], room=100, monkeypatch=monkeypatch) == texts[1:2]
    assert kept_of(texts, room=100, monkeypatch=monkeypatch) == texts[2:]


class SlowPlan:
    """A motion whose planner has not reported its plan yet."""

    def __init__(self):
        self.is_there = threading.Event()
        self.looks = threading.Semaphore(0)

    def await_event(self, is_urgent):
        while not self.is_there.wait(0.001):
            self.looks.release()
            if is_urgent():
                return False
        return True

    @property
    def event(self):
        there = self.is_there.is_set()
        return pb.Event(plan=pb.Plan(duration=7.0)).SerializeToString() if there else b""


def test_a_fault_waits_for_no_plan_and_the_recording_gets_that_later():
    journal, plan = Journal(kept=60.0), SlowPlan()
    told = threading.Semaphore(0)
    watcher = journal.subscribe("arm", told.release)
    queued = SimpleNamespace(planned=plan, first_index=None, number=1)
    journal.on_event(DeviceEvent("arm", EventKind.MOTION_STARTED, "", 1, queued=queued))
    assert plan.looks.acquire(timeout=10.0)
    assert not told.acquire(blocking=False)
    journal.on_event(DeviceEvent("arm", EventKind.FAULT, "link_lost", 2))
    assert told.acquire(timeout=10.0)
    assert told.acquire(timeout=10.0)
    started, fault = watcher.take().events
    assert (started.kind, started.HasField("plan")) == (pb.EVENT_KIND_MOTION_STARTED, False)
    assert (fault.kind, fault.text) == (pb.EVENT_KIND_FAULT, "link_lost")
    plan.is_there.set()
    journal.on_event(DeviceEvent("arm", EventKind.WARNING, "later", 3))
    journal.close()
    kept = [pb.Event.FromString(event) for event in journal.kept("arm", 0)]
    assert [
        event.plan.duration for event in kept if event.kind == pb.EVENT_KIND_MOTION_STARTED
    ] == [7.0]
    assert len(watcher.take().events) == 1
