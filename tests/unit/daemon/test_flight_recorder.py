"""The flight recorder delays no other process, not even the end of the daemon."""

import logging
import time

import pytest
from fake_device import FakeDevice, cycle, record_of

from orientd import config
from orientd.daemon.device import DeviceEvent, EventKind
from orientd.daemon.observe import flight_recorder as module
from orientd.daemon.observe.journal import Journal
from orientd.stream.records import CYCLE_RECORD
from orientd.stream.ring import RecordRing

pytest.importorskip("mcap")


def test_a_file_that_takes_its_time_does_not_hold_up_the_end(tmp_path, monkeypatch, caplog):
    slow = tmp_path / "slow"
    slow.write_text("#!/bin/sh\nexec sleep 20\n")
    slow.chmod(0o755)
    monkeypatch.setattr(module.sys, "executable", str(slow))
    monkeypatch.setattr(module, "FINISHING", 0.3)
    settings = config.default_settings()
    journal = Journal(kept=60.0)
    device = FakeDevice(settings.devices["arm"])
    recorder = module.FlightRecorder(settings, journal, {"arm": device})
    cycles = memoryview(bytearray(RecordRing.bytes_needed(CYCLE_RECORD, 100)))
    ring = RecordRing(cycles, CYCLE_RECORD, 100)
    ring.append(record_of(cycle()))
    recorder.memory("arm", device.rate_hz).take(ring, is_last=True)
    recorder.start()
    recorder.on_event(DeviceEvent("arm", EventKind.FAULT, "why", time.monotonic_ns()))
    recorder.close()
    assert "not written yet when the daemon ended" in caplog.text
    journal.close()
    (process,) = recorder.unfinished
    assert process.poll() is None
    process.kill()
    process.wait()


def test_an_unexpected_error_is_told_and_later_faults_are_recorded(monkeypatch, caplog):
    monkeypatch.setattr(module, "AFTERWARDS", 0.0)
    settings = config.default_settings()
    journal, device = Journal(kept=60.0), FakeDevice(settings.devices["arm"])
    recorder = module.FlightRecorder(settings, journal, {"arm": device})
    cycles = memoryview(bytearray(RecordRing.bytes_needed(CYCLE_RECORD, 100)))
    ring = RecordRing(cycles, CYCLE_RECORD, 100)
    ring.append(record_of(cycle()))
    recorder.memory("arm", device.rate_hz).take(ring, is_last=True)
    device.snapshot = lambda: 1 / 0
    recorder.start()
    for _ in range(2):
        recorder.on_event(DeviceEvent("arm", EventKind.FAULT, "why", time.monotonic_ns()))
    recorder.close()
    journal.close()
    assert caplog.text.count("ZeroDivisionError: division by zero") >= 2


def test_a_flight_recorder_that_nobody_installed_is_no_warning(monkeypatch, caplog):
    monkeypatch.setattr(module, "_is_installed", lambda: False)
    caplog.set_level(logging.INFO)
    recorder = module.FlightRecorder(config.default_settings(), Journal(), {})
    recorder.start()
    (record,) = caplog.records
    assert (record.levelname, "needs the extra `record`" in record.message) == ("INFO", True)
