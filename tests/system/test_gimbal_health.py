"""The health of servos, from their bus to those who look: status, metrics, recordings."""

import re
import urllib.request

import pytest
from command_line import begin, environment, orientd
from gimbal_bench import GimbalDaemon
from harness import free_port, until
from recorded_facts import states

from orientd import connect
from orientd.protocol.reports import word

pytest.importorskip("dynamixel_sdk")

pytestmark = pytest.mark.world


@pytest.fixture
def daemon(bus, tmp_path):
    it = GimbalDaemon(tmp_path, bus.link)
    it.process = None
    yield it
    if it.process is not None and it.process.poll() is None:
        it.end()


def test_what_servos_measure_is_told_everywhere_with_a_warning_in_time(bus, daemon, tmp_path):
    port = free_port()
    daemon.config.write_text(f"[metrics]\nport = {port}\n{daemon.config.read_text()}")
    daemon.start()
    bus.tell("heat 2 75")
    with connect(daemon.socket) as robot:

        def warned():
            parts = {part.name: part for part in robot.state().devices["gimbal"].health}
            return parts if parts and parts["pitch"].warning else None

        parts = until(warned, "the warning")
        assert list(parts) == ["yaw", "pitch", "roll"]
        assert (parts["yaw"].voltage, parts["yaw"].temperature) == (12.0, 32.0)
        assert parts["pitch"].temperature == 75.0
        assert 0.0 <= parts["pitch"].age < 3.0
        assert not parts["pitch"].is_stale
    shown = orientd("status", "--socket", daemon.socket).stdout
    said = "servo 2 (pitch) has 75 degrees C, at 80 it gives up"
    assert re.search(
        rf"pitch +12.0 V, 75 degrees C, 0.00 A, \d.\d s ago; warning: {re.escape(said)}", shown
    )

    def metrics():
        with urllib.request.urlopen(f"http://127.0.0.1:{port}/metrics") as answer:
            return answer.read().decode()

    # What was overwritten in three servos, and this; on a busy machine, late reads too.
    warnings = re.search(r'orientd_warnings_total{device="gimbal"} (\d+)', metrics())
    counted = int(warnings[1])
    for line in (
        'orientd_part_temperature_celsius{device="gimbal",part="pitch"} 75.0',
        'orientd_part_voltage_volts{device="gimbal",part="roll"} 12.0',
    ):
        until(lambda line=line: line in metrics(), line)
    out = tmp_path / "a.mcap"
    assert orientd("record", out, "--seconds", "1", "--socket", daemon.socket).returncode == 0
    (state, *_) = states(out)
    assert [part.temperature for part in state.devices[0].health] == [32.0, 75.0, 32.0]
    log = daemon.end()[1]
    assert 4 <= counted <= log.count("WARNING gimbal: warning:")
    assert f"WARNING gimbal: warning: {said}" in log
    assert "WARNING gimbal: warning: servo 1 (yaw): operating mode 3 is set to 4" in log


def test_servos_that_are_powered_later_are_found_then(bus, daemon):
    bus.tell("disconnect 2")
    daemon.log = (daemon.folder / "log").open("ab")
    daemon.process = begin(
        "run", "--config", daemon.config,
        env=environment(XDG_STATE_HOME=str(daemon.folder / "state")),
    )  # fmt: skip
    assert "not ready" in daemon.process.stdout.readline()
    with connect(daemon.socket) as robot:
        device = robot.state().devices["gimbal"]
        assert word(device, "fault") == "link_lost"
        assert "servo 2 (pitch) does not answer" in device.fault_text
    bus.tell("connect 2")
    assert daemon.process.stdout.readline().startswith("ready")
    with connect(daemon.socket) as robot:
        assert word(robot.state().devices["gimbal"], "state") == "holding"
