"""`orientd bench` with a device that does not do what it should."""

import functools
import json

import pytest
from command_line import assert_refused, inside

from orientd.bench import retarget, servo


@pytest.fixture
def fault(monkeypatch, tmp_path):
    """Return the file whose content is the fault of the device that is measured."""
    path = tmp_path / "fault"
    more = f"[devices.{servo.DEVICE}.options]\nfault_file = {json.dumps(str(path))}\n"
    monkeypatch.setattr(retarget, "daemon", functools.partial(servo.daemon, more=more))
    monkeypatch.setattr(retarget, "_WARM_UP", 1)
    return path


@pytest.mark.parametrize("motions", [0, 4, 13])
def test_a_device_that_faults_is_one_line(fault, monkeypatch, motions):
    """Before the first motion, amid the retargets, and in the last one of them."""
    begun, begin = [], retarget._retarget

    def begin_or_fault(*arguments):
        begun.append(begin(*arguments))
        if len(begun) == motions:
            fault.write_text("device_fault")
        return begun[-1]

    if not motions:
        fault.write_text("device_fault")
    monkeypatch.setattr(retarget, "_retarget", begin_or_fault)
    result = inside("bench", "retarget", "--count", "10", "--keyframes", "1")
    assert_refused(result, "injected fault: device_fault")
    assert len(begun) == motions
