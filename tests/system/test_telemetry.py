"""A daemon that is watched: what Prometheus scrapes, and a motion's story in the log."""

import json
import re
import urllib.request

import grpc
import pytest
from harness import DEVICE, DaemonProcess, nudge, until
from motions import through

from orientd.protocol import control_pb2 as pb

pytestmark = pytest.mark.world

pytest.importorskip("prometheus_client")


@pytest.fixture(scope="module")
def daemon(tmp_path_factory):
    process = DaemonProcess(tmp_path_factory.mktemp("daemon"), arguments=["--log-format", "json"])
    process.config.write_text("[metrics]\nport = 0\n" + process.config.read_text())
    with process:
        yield process


def log(daemon):
    return [json.loads(line) for line in (daemon.folder / "log").read_text().splitlines()]


def scrape(daemon):
    (line,) = (one["message"] for one in log(daemon) if one["message"].startswith("metrics: "))
    with urllib.request.urlopen(line.removeprefix("metrics: ")) as answer:
        text = answer.read().decode()
    return dict(re.findall(r"^(orientd_\S+(?:\{.*\})?) (\S+)$", text, re.MULTILINE))


def test_what_a_motion_did_is_counted(daemon):
    *_, last = daemon.move(nudge(0.2))
    assert last.summary.outcome == pb.OUTCOME_DONE
    with pytest.raises(grpc.RpcError):
        daemon.stub.Enable(pb.CommandRequest())
    done = f'orientd_motions_total{{device="{DEVICE}",outcome="done"}}'
    refused = 'orientd_rpcs_total{code="FAILED_PRECONDITION",method="Enable"}'
    # Whoever asks may know before it is counted.
    until(lambda: {done, refused} <= scrape(daemon).keys(), "the counts")
    found = scrape(daemon)
    assert (found[done], found[refused]) == ("1.0", "1.0")
    cycles = f'orientd_cycles_total{{device="{DEVICE}"}}'
    # Cycles are counted every now and then.
    until(lambda: float(scrape(daemon)[cycles]) > last.summary.statistics.cycles, "the cycles")
    assert 0.0 <= float(found[f'orientd_cycle_success_ratio{{device="{DEVICE}"}}']) <= 1.0


@pytest.mark.real
def test_the_story_of_a_motion_is_found_by_its_id(daemon):
    *_, last = daemon.move(nudge(0.1))
    number, motion_id = daemon.started.motion_number, daemon.started.plan.motion_id

    def story():
        return [one for one in log(daemon) if one.get("motion_id") == motion_id]

    told = until(lambda: len(story()) >= 5 and story(), "the story")
    assert {one["motion"] for one in told} == {number}
    assert {one["device"] for one in told if one.get("device")} == {DEVICE}
    events = [one["event"] for one in told if "event" in one]
    assert events == ["motion started", "motion done"]
    assert told[-1]["method"] == "Move"
    assert told[-1]["motion_outcome"] == "OUTCOME_DONE"
    assert last.summary.motion_number == number
    assert any(one.get("identity", "").startswith("user:") for one in told)


@pytest.mark.real
def test_a_motion_is_called_by_its_name_in_reports_in_the_log_and_in_events(daemon):
    motion = through([(0, 0, 0), (0.2, 0, 0.2)], approach=True, name="fetch")
    watching = daemon.stub.WatchEvents(pb.WatchEventsRequest())
    next(watching)
    daemon.move(motion)
    assert daemon.started.plan.name == "fetch"
    (report,) = daemon.stub.GetState(pb.GetStateRequest()).devices
    assert (report.motion_name, report.motion_id) == ("fetch", daemon.started.plan.motion_id)
    started = next(event for told in watching for event in told.events if event.motion)
    watching.cancel()
    assert (json.loads(started.motion)["name"], started.plan.name) == ("fetch", "fetch")

    def story():
        return [one for one in log(daemon) if one.get("motion_name") == "fetch"]

    told = until(lambda: len(story()) >= 3 and story(), "the story")
    assert [one["event"] for one in told if "event" in one] == ["motion started", "motion done"]
    assert all(f"{report.motion_number} 'fetch'" in one["message"] for one in told)


def test_no_secret_is_in_the_log(daemon):
    assert daemon.token not in (daemon.folder / "log").read_text()
