"""Metrics for Prometheus, in its format and by its conventions."""

import json
import re
import urllib.request
from dataclasses import replace
from pathlib import Path

import fake_device
import pytest

from orientd import config
from orientd.config import MetricsSettings
from orientd.daemon.calls.telemetry import Telemetry
from orientd.daemon.device import DeviceEvent, EventKind
from orientd.driver import PartHealth
from orientd.errors import ConfigError, Fault
from orientd.stream.records import CycleFlag, ServoState

pytest.importorskip("prometheus_client")

DASHBOARD = Path(__file__).parents[3] / "config" / "grafana.json"


def cycle(index, *, missed=0, **fields):
    """Return a cycle whose feedback was measured 3 ms before its deadline."""
    made = fake_device.cycle(index, **{"lateness_ns": 20_000, **fields})
    measured_ns = made.deadline_ns - 3_000_000
    return replace(made, feedback_time_ns=measured_ns, flags=CycleFlag.FEEDBACK, missed=missed)


class MeasuredDevice(fake_device.FakeDevice):
    """A device that tells of its health, without a cycle so far."""

    def __init__(self):
        super().__init__(config.default_settings().devices["arm"])
        self.published, self.fault = [], Fault.NONE

    def snapshot(self):
        return replace(
            super().snapshot(),
            fault=self.fault,
            tracking_error=0.01,
            health=(PartHealth("yaw", 0, 12.1, 41.0, 0.5),),
            longest_calls={"read": 0.003, "write": 0.001},
        )


_UNITS = ("seconds", "radians", "ratio", "state", "info", "volts", "celsius", "amperes")


@pytest.fixture
def device():
    return MeasuredDevice()


@pytest.fixture
def telemetry(device):
    made = Telemetry(devices={"arm": device})
    yield made
    made.close()


def value(telemetry, name, **labels):
    return telemetry.registry.get_sample_value(f"orientd_{name}", labels)


def test_cycles_are_counted_once_and_by_how_late_they_were(telemetry, device):
    device.published = [cycle(k) for k in range(50)]
    device.published += [
        cycle(50, lateness_ns=1_500_000, overruns=1),
        cycle(51, overruns=1, missed=3),
    ]
    telemetry.sample()
    telemetry.sample()
    assert value(telemetry, "cycles_total", device="arm") == 52
    assert value(telemetry, "cycle_overruns_total", device="arm") == 1
    assert value(telemetry, "cycle_missed_deadlines_total", device="arm") == 3
    assert value(telemetry, "cycle_lateness_seconds_count", device="arm") == 52
    assert value(telemetry, "cycle_lateness_seconds_bucket", device="arm", le="0.001") == 51
    assert value(telemetry, "feedback_age_seconds", device="arm") == pytest.approx(3e-3)
    assert value(telemetry, "cycle_age_seconds", device="arm") > 0.0
    assert value(telemetry, "tracking_error_radians", device="arm") == 0.01
    assert value(telemetry, "driver_call_longest_seconds", device="arm", call="read") == 0.003
    assert value(telemetry, "driver_call_longest_seconds", device="arm", call="write") == 0.001
    assert value(telemetry, "device_state", device="arm", state="holding") == 1
    assert value(telemetry, "device_state", device="arm", state="fault") == 0


def event(kind):
    return DeviceEvent("arm", kind, "", 0)


def test_motions_and_faults_are_counted_by_what_they_were(telemetry, device):
    telemetry.on_event(event(EventKind.MOTION_DONE), device)
    telemetry.on_event(event(EventKind.MOTION_STOPPED), device)
    device.state, device.fault = ServoState.FAULT, Fault.LINK_LOST
    telemetry.on_event(event(EventKind.FAULT), device)
    telemetry.on_event(event(EventKind.MOTION_STOPPED), device)
    for outcome in ("done", "stopped", "fault"):
        assert value(telemetry, "motions_total", device="arm", outcome=outcome) == 1
    assert value(telemetry, "faults_total", device="arm", kind="link_lost") == 1


def test_it_is_served_at_the_loopback_interface():
    telemetry = Telemetry(MetricsSettings(port=0))
    telemetry.count_call("Move", "OK", 0.02)
    port = telemetry.port
    with urllib.request.urlopen(f"http://127.0.0.1:{port}/metrics") as answer:
        text = answer.read().decode()
    assert 'orientd_rpcs_total{code="OK",method="Move"} 1.0' in text
    with pytest.raises(ConfigError, match=f"cannot listen at 127.0.0.1:{port}"):
        Telemetry(MetricsSettings(port=port))
    telemetry.close()


def names(telemetry):
    return {
        name
        for family in telemetry.registry.collect()
        for name in (
            family.name,
            *(f"{family.name}_{end}" for end in ("total", "bucket", "sum", "count")),
        )
    }


def test_names_end_in_their_unit(telemetry):
    for family in telemetry.registry.collect():
        last = family.name.rpartition("_")[2]
        if family.type == "histogram":
            assert last == "seconds"
        if family.type == "gauge":
            assert last in _UNITS, family.name


def test_the_dashboard_asks_for_what_there_is(telemetry):
    board = json.loads(DASHBOARD.read_text())
    asked = {
        name
        for panel in board["panels"]
        for target in panel["targets"]
        for name in re.findall(r"orientd_\w+", target["expr"])
    }
    assert asked
    assert asked <= names(telemetry)
    shown = {re.sub(r"_(bucket|total)$", "", name) for name in asked}
    assert shown == {family.name for family in telemetry.registry.collect()}
    assert len({panel["id"] for panel in board["panels"]}) == len(board["panels"])
