"""A recording of a cell of three real daemons, one of which has a clock of its own."""

import json
import signal

import numpy as np
import pytest
from command_line import begin, environment, orientd
from fleet_cell import CELL, RunningCell, can_have_own_clocks
from harness import until
from recorded_facts import clocks, configurations

from orientd import rotation
from orientd.errors import DaemonError
from orientd.motion_file import parse
from orientd.protocol import control_pb2 as pb
from orientd.recorder.planned import planned_orientations
from orientd.recorder.reader import load_recording
from orientd_fleet.together import FleetMotion, move_together
from orientd_replay.orientations import read_orientations

pytest.importorskip("zenoh")
pytest.importorskip("mcap")

TURN = parse({"keyframes": [{"rotation_vector": [0.0, 0.0, 0.3]}]})
OTHER = "arm-3"
AHEAD = 1000.0 if can_have_own_clocks() else 0.0


@pytest.fixture(scope="module")
def cell(tmp_path_factory):
    folder = tmp_path_factory.mktemp("cell")
    folder.chmod(0o700)
    with RunningCell(folder, 3, ahead={OTHER: AHEAD} if AHEAD else None) as cell:
        yield cell


@pytest.fixture(scope="module")
def recorded(cell, tmp_path_factory):
    """A recording by the command, meanwhile a motion of all: how it went, file, what was said."""
    path = tmp_path_factory.mktemp("recorded") / "cell.mcap"
    variables = environment(ORIENTD_FLEET=cell.endpoint, ORIENTD_CELL=CELL)
    process = begin("fleet", "record", path, "--json", env=variables)
    with cell.fleet() as fleet:
        until(lambda: path.exists() and path.stat().st_size > 20_000, "a recording", 30.0)
        together = move_together(fleet, [FleetMotion(name, "", TURN) for name in cell.names])
    process.send_signal(signal.SIGINT)
    output, errors = process.communicate(timeout=20)
    assert (process.returncode, errors) == (0, "")
    return together, path, json.loads(output)


def test_every_cycle_event_and_plan_of_each_daemon_is_in_the_file(cell, recorded):
    _, path, told = recorded
    recording = load_recording(path)
    devices = [f"{name}/arm" for name in cell.names]
    assert sorted(recording.cycles) == devices
    for device in devices:
        cycles = recording.cycles[device]
        assert told["cycles"][device] == len(cycles)
        assert told["lost"][device] == 0
        assert np.all(np.diff(cycles["index"]) == 1)
        events = [event for event in recording.events if event.device == device]
        kinds = [event.kind for event in events]
        assert kinds == [pb.EVENT_KIND_MOTION_STARTED, pb.EVENT_KIND_MOTION_DONE]
        _, planned = planned_orientations(recording, device)
        known = np.isfinite(planned[:, 0])
        away = rotation.angle(planned[known], cycles["sent_q"][known])
        assert np.count_nonzero(known) >= events[0].plan.duration * 500
        assert float(away.max()) < 3e-4
    settings = configurations(path)
    assert sorted(settings) == cell.names
    assert list(settings["arm-2"]["devices"]) == ["arm"]


def test_all_is_on_one_clock_whatever_a_daemon_has(cell, recorded):
    together, path, _ = recorded
    recording = load_recording(path)
    told = clocks(path)
    assert sorted(told) == cell.names
    for name, facts in told.items():
        true_ns = round(AHEAD * 1e9) if name == OTHER else 0
        assert all(abs(fact.offset_ns - true_ns) <= fact.bound_ns for fact in facts)
    assert together.skew is not None
    begun = []
    for event in recording.events:
        if event.kind == pb.EVENT_KIND_MOTION_STARTED:
            cycles = recording.cycles[event.device]
            first = np.flatnonzero(cycles["motion"] == event.motion_number)[0]
            begun.append(int(cycles["deadline_ns"][first]) * 1e-9)
            assert event.time_ns * 1e-9 == pytest.approx(begun[-1], abs=5.0)
    assert max(begun) - min(begun) < 1.0  # begun together; a clock of its own is 1000 s ahead


def test_what_reads_recordings_reads_it(cell, recorded, tmp_path):
    _, path, _ = recorded
    found = read_orientations(path, "/arm-3/arm/sent")
    # From where it was, which is the same for all of them.
    turned = rotation.angle(found.q[0], found.q[-1])
    assert float(turned) == pytest.approx(0.3, abs=1e-6)
    done = orientd("replay", path, "--topic", "/arm-2/arm/sent", "--dry-run", "--json")
    assert json.loads(done.stdout)["fit"]["topic"] == "/arm-2/arm/sent"
    done = orientd("export", path, "-d", "arm-1/arm", "-o", tmp_path / "a.csv", "--json")
    assert json.loads(done.stdout)["rows"] == len(load_recording(path).cycles["arm-1/arm"])


def test_a_daemon_that_leaves_is_told_of_and_the_others_go_on(cell, tmp_path):
    path = tmp_path / "cell.mcap"
    with cell.fleet() as fleet:
        with fleet.record(path) as recording:
            cell.end("arm-2", signal.SIGKILL)
            until(lambda: "arm-2" in recording.problems, "arm-2 is missed")
            before = recording.cycles["arm-1/arm"]
            until(lambda: recording.cycles["arm-1/arm"] > before + 200, "others go on")
            cell.start("arm-2")
            cell.await_ready("arm-2")
            before = recording.cycles["arm-2/arm"]
            until(lambda: recording.cycles["arm-2/arm"] > before, "it is back")
        cycles = load_recording(path).cycles
        assert {name: len(table) for name, table in cycles.items()} == recording.cycles
        assert not list(recording.problems)[1:]


def test_a_daemon_that_is_not_there_is_refused(cell, tmp_path):
    with cell.fleet() as fleet, pytest.raises(DaemonError, match="has no arm-9"):
        fleet.record(tmp_path / "a.mcap", ["arm-9"]).run()
