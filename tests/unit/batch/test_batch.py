"""Batches of requests: the same table however it came about, each refusal in its row."""

import itertools
import json
import math
import pickle
import subprocess
import sys

import numpy as np
import pytest
from click.testing import CliRunner
from pyarrow import parquet

from orientd import motion_file
from orientd.cli.command import device_settings
from orientd.cli.main import app
from orientd.errors import LimitError, LimitKind, OrientdError, RequestError
from orientd.planner import offline
from orientd.planner.offline import plan_many
from orientd.planner.planning import plan
from orientd.planner.state import State
from orientd_batch import batch
from orientd_batch.batch import RECORD, plan_file

pytestmark = pytest.mark.filterwarnings("ignore:resource_tracker:UserWarning")

DEVICE = device_settings(None, "")


def q(angle):
    return {"w": math.cos(angle / 2), "x": 0.0, "y": 0.0, "z": math.sin(angle / 2)}


def motion(angle, **more):
    return {"keyframes": [{"quaternion": q(0.0)}, {"quaternion": q(angle)}], **more}


MOTIONS = [
    motion(0.5, name="one"),
    motion(1.0, name="two", end_velocity=[0, 0, 0.3]),
    {"keyframes": [{"quaternion": q(1.0)}], "name": "alone"},
    motion(0.7, methd="c2_cumulative", name="typo"),
    motion(0.6),
]


@pytest.fixture(autouse=True)
def small_parts(monkeypatch):
    monkeypatch.setattr(batch, "PART", 2)


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "requests.jsonl"
    path.write_text("\n\n".join(map(json.dumps, MOTIONS)) + "\n{nonsense\n")
    return path


def planned(file, folder, parts=None, *, jobs=1, has_records=False):
    """Run a batch, to its end or for some parts, and return its rows."""
    run = plan_file(file, folder, DEVICE, jobs=jobs, has_records=has_records)
    for _ in itertools.islice(run, parts):
        pass
    return parquet.read_table(folder / "plans.parquet").to_pylist() if parts is None else None


def test_each_request_has_its_row_with_its_certificate_or_its_refusal(file, tmp_path):
    rows = planned(file, tmp_path / "plans")
    assert [row["row"] for row in rows] == list(range(6))
    assert [row["name"] for row in rows] == ["one", "two", "alone", "typo", "", ""]
    assert [row["outcome"] for row in rows] == [
        "planned", "planned", "refused", "refused", "planned", "refused",
    ]  # fmt: skip
    assert rows[2]["refusal"].startswith("keyframes: expected at least 2")
    assert "did you mean 'method'" in rows[3]["refusal"]
    assert rows[5]["refusal"].startswith("not JSON")
    request = motion_file.parse(MOTIONS[1])
    limits, period = DEVICE.limits.to_limits(), DEVICE.period_ns * 1e-9
    start = State.at_rest(request.keys[0])
    certificate = plan(request, start=start, limits=limits, period=period).certificate
    assert rows[1]["duration"] == certificate.duration
    assert rows[1]["peak_jerk"] == certificate.peak_jerk.value
    assert rows[1]["limit_velocity"] == limits.velocity
    assert rows[1]["lead_out"] == certificate.lead_out > 0.0


def test_a_line_of_other_characters_is_refused_in_its_row(file, tmp_path):
    with file.open("ab") as lines:
        lines.write(b'{"name": "\xff"}\r\n')
    rows = planned(file, tmp_path / "plans")
    assert [row["outcome"] for row in rows[4:]] == ["planned", "refused", "refused"]
    assert rows[6]["refusal"].startswith("not JSON: 'utf-8'")


def test_a_batch_that_was_ended_goes_on_to_the_same_file(file, tmp_path):
    planned(file, tmp_path / "whole")
    planned(file, tmp_path / "ended", parts=2)
    assert len(list((tmp_path / "ended" / "parts").glob("*.parquet"))) == 1
    planned(file, tmp_path / "ended")
    one, other = (tmp_path / name / "plans.parquet" for name in ("whole", "ended"))
    assert one.read_bytes() == other.read_bytes()
    assert not (tmp_path / "ended" / "parts").exists()


def test_workers_make_the_same_file(file, tmp_path):
    assert planned(file, tmp_path / "one") == planned(file, tmp_path / "two", jobs=2)


def test_records_are_those_of_the_motion(file, tmp_path):
    planned(file, tmp_path / "plans", has_records=True)
    records = parquet.read_table(tmp_path / "plans" / "records" / "000000.parquet")
    request = motion_file.parse(MOTIONS[1])
    made = plan(
        request, start=State.at_rest(request.keys[0]),
        limits=DEVICE.limits.to_limits(), period=DEVICE.period_ns * 1e-9,
    )  # fmt: skip
    second = records.filter(np.array(records["row"]) == 1)
    assert second["record"].to_pylist() == list(range(made.record_count))
    found = np.column_stack([second[name] for name in RECORD])
    np.testing.assert_array_equal(found, made.rows(0, made.record_count)[:, :13])


def test_another_batch_in_the_folder_is_refused(file, tmp_path):
    planned(file, tmp_path / "plans", parts=1)
    with pytest.raises(OrientdError, match="a batch with other records; expected a new folder"):
        planned(file, tmp_path / "plans", has_records=True)


@pytest.mark.parametrize(
    ("name", "content", "says"),
    [
        ("a.txt", "", "expected a file that ends in .jsonl, got a.txt; the guide on batches"),
        ("b/a.jsonl", None, "cannot read .*No such file"),
    ],
)
def test_a_file_that_is_none_of_requests_is_refused(tmp_path, name, content, says):
    if content is not None:
        (tmp_path / name).write_text(content)
    with pytest.raises(OrientdError, match=says):
        planned(tmp_path / name, tmp_path / "plans")


def test_a_file_in_place_of_the_folder_is_refused(file):
    with pytest.raises(OrientdError, match=r"^expected a folder for the plans, .* is a file$"):
        planned(file, file)


def test_many_motions_come_in_order_with_refusals_in_their_places():
    requests = [motion_file.parse(motion(angle)) for angle in (0.5, 1.0, 0.2)]
    fast = motion(2.0)
    fast["keyframes"][0]["time"], fast["keyframes"][1]["time"] = 0.0, 1e-3
    requests.insert(1, motion_file.parse(fast))
    found = list(plan_many(iter(requests), jobs=2))
    assert isinstance(found[1], LimitError)
    assert isinstance(found[1], OrientdError)
    assert found[1].quantity
    for one, request in zip(found[:1] + found[2:], requests[:1] + requests[2:], strict=True):
        assert one.request == request


def test_errors_cross_processes_as_they_are():
    limit = LimitError("jerk", 3.0, 2.0, 0.5, "rad/s^3", kind=LimitKind.JERK)
    for error in (RequestError("times", "expected one"), OrientdError("plain"), limit):
        arrived = pickle.loads(pickle.dumps(error))
        assert (type(arrived), str(arrived)) == (type(error), str(error))
        assert vars(arrived) == vars(error)


def test_the_command_says_how_far_it_is_and_what_it_wrote(file, tmp_path):
    command = [sys.executable, "-m", "orientd", "batch", file, "-o", tmp_path / "plans"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.startswith("0 of 6 requests (0%)\n")
    assert done.stdout.endswith(f"wrote {tmp_path / 'plans' / 'plans.parquet'}\n")
    done = subprocess.run(
        [*command, "--backend", "grid"], capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stdout) == (1, "")
    assert done.stderr == "orientd: expected a backend of loky, ray, dask, got 'grid'\n"


def test_the_address_of_a_cluster_is_that_of_no_daemon(file, tmp_path):
    folder = tmp_path / "plans"
    command = ["batch", str(file), "-o", str(folder), "--address", "127.0.0.1:9"]
    ended = CliRunner().invoke(app, command)
    assert (ended.exit_code, ended.stdout) == (1, "0 of 6 requests (0%)\n")
    says = "a cluster's address needs the backend ray or dask, got 127.0.0.1:9"
    assert ended.stderr == f"orientd: {says}\n"


def test_a_cluster_that_is_not_there_is_said_not_to_be(monkeypatch):
    monkeypatch.setattr(offline, "find_spec", lambda name: name)
    with pytest.raises(OrientdError, match=r"no ray cluster at 127.0.0.1:9: .*refused"):
        next(plan_many([], backend="ray", address="127.0.0.1:9"))
