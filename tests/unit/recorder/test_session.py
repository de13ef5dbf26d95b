"""Recordings of a fake daemon; tests/system has real daemons."""

import threading
from types import SimpleNamespace

import numpy as np
from recorded import OFFSET_NS, RATE_HZ, decoded, moving

from orientd.client.observer import Configuration
from orientd.protocol import control_pb2 as pb
from orientd.recorder.reader import load_recording
from orientd.recorder.session import DaemonRecorder, LiveRecording, RecordingSession
from orientd.recorder.writer import RecordingWriter


class Daemon:
    """A daemon with the devices arm and leg that has batches of cycles, and then nothing new."""

    def __init__(self, batches, events=()):
        self.batches, self._events = batches, events
        self.closed = threading.Event()
        self.served = threading.Semaphore(0)

    def devices(self):
        return [SimpleNamespace(name=name, rate_hz=RATE_HZ) for name in ("arm", "leg")]

    def observe(self):
        return self

    def configuration(self):
        return Configuration('{"devices": {}}', OFFSET_NS)

    def state(self):
        return pb.GetStateResponse(devices=[pb.DeviceReport(name="arm")])

    def records(self, device, *, rate_hz):
        for table, lost in self.batches.get(device, ()):
            yield table.tobytes(), lost
        self.served.release()
        self.closed.wait()

    def events(self):
        for event in self._events:
            yield pb.Event.FromString(event.SerializeToString())
        self.served.release()
        self.closed.wait()

    def close(self):
        self.closed.set()


def end_when_served(daemon, recording, streams):
    """Have a recording end once each stream has given all that it has."""

    def wait():
        for _ in range(streams):
            daemon.served.acquire()
        recording.end()

    threading.Thread(target=wait, daemon=True).start()


def events():
    return [
        pb.Event(device=name, kind=pb.EVENT_KIND_FAULT, time_ns=7_000_000_000, text=name)
        for name in ("arm", "leg")
    ]


def test_every_batch_event_and_state_is_in_the_file(tmp_path):
    table = moving(300)
    daemon = Daemon(
        {"arm": [(table[:100], 0), (table[100:], 3)], "leg": [(table[:5], 0)]}, events()
    )
    session = RecordingSession(daemon, tmp_path / "a.mcap")
    end_when_served(daemon, session, 3)
    session.run()
    recording = load_recording(tmp_path / "a.mcap")
    np.testing.assert_array_equal(recording.cycles["arm"]["index"], table["index"])
    np.testing.assert_array_equal(recording.cycles["arm"]["deadline_ns"], table["deadline_ns"])
    assert len(recording.cycles["leg"]) == 5
    assert recording.events == events()
    assert recording.offset_ns == OFFSET_NS
    assert recording.rate_hz("arm") == recording.rate_hz("leg") == RATE_HZ
    assert (dict(session.cycles), session.events) == ({"arm": 300, "leg": 5}, 2)
    assert dict(session.lost) == {"arm": 3, "leg": 0}
    (state,) = [content for topic, *_, content in decoded(tmp_path / "a.mcap") if topic == "/state"]
    assert state.devices[0].name == "arm"


def test_a_file_says_whose_it_is_before_anything_has_happened(tmp_path):
    path, sizes = tmp_path / "a.mcap", []
    daemon = Daemon({})
    live = LiveRecording(path)
    end_when_served(daemon, live, 2)

    def look():
        sizes.append(len(path.read_bytes()))
        assert b"clock_offset_ns" in path.read_bytes()

    with RecordingWriter(path, offset_ns=OFFSET_NS) as writer:
        recorder = DaemonRecorder(daemon, ["arm"])
        recorder.run(writer, daemon.configuration(), live, on_state=look)
    assert len(sizes) == 1


def test_only_the_devices_that_are_named_are_recorded(tmp_path):
    daemon = Daemon({"arm": [(moving(5), 0)], "leg": [(moving(5), 0)]}, events())
    session = RecordingSession(daemon, tmp_path / "a.mcap", ["leg"])
    end_when_served(daemon, session, 2)
    session.run()
    recording = load_recording(tmp_path / "a.mcap")
    assert set(recording.cycles) == {"leg"}
    assert recording.events == events()[1:]
