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


@pytest.fixture
def recorder():
    """A recorder of a device that has done one cycle, and what ends its journal."""
    settings, journal = config.default_settings(), Journal(kept=60.0)
    device = FakeDevice(settings.devices["arm"])
    recorder = module.FlightRecorder(settings, journal, {"arm": device})
    ring = RecordRing(
        memoryview(bytearray(RecordRing.bytes_needed(CYCLE_RECORD, 100))), CYCLE_RECORD, 100
    )
    ring.append(record_of(cycle()))
    recorder.memory("arm", device.rate_hz).take(ring, is_last=True)
    recorder.start()
    yield recorder, device
    recorder.close()
    journal.close()


def fault():
    return DeviceEvent("arm", EventKind.FAULT, "why", time.monotonic_ns())


def test_a_file_that_takes_its_time_does_not_hold_up_the_end(
    recorder, tmp_path, monkeypatch, caplog
):
    slow = tmp_path / "slow"
    slow.write_text("#!/bin/sh\nexec sleep 20\n")
    slow.chmod(0o755)
    monkeypatch.setattr(module.sys, "executable", str(slow))
    monkeypatch.setattr(module, "FINISHING", 0.3)
    it, _ = recorder
    it.on_event(fault())
    it.close()
    assert "not written yet when the daemon ended" in caplog.text
    (process,) = it.unfinished
    assert process.poll() is None
    process.kill()
    process.wait()


def test_an_unexpected_error_is_told_and_later_faults_are_recorded(recorder, monkeypatch, caplog):
    monkeypatch.setattr(module, "AFTERWARDS", 0.0)
    it, device = recorder
    device.snapshot = lambda: 1 / 0
    for _ in range(2):
        it.on_event(fault())
    it.close()
    assert caplog.text.count("ZeroDivisionError: division by zero") >= 2


def test_a_flight_recorder_that_nobody_installed_is_no_warning(monkeypatch, caplog):
    monkeypatch.setattr(module, "_is_installed", lambda: False)
    caplog.set_level(logging.INFO)
    recorder = module.FlightRecorder(config.default_settings(), Journal(), {})
    recorder.start()
    (record,) = caplog.records
    assert (record.levelname, "needs the extra `record`" in record.message) == ("INFO", True)
