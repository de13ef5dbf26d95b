"""A recording as a table: every column, its name, its unit and the cells that are empty."""

import csv

import numpy as np
import pytest
from recorded import OFFSET_NS, RATE_HZ, moving

from orientd.errors import Fault
from orientd.recorder.reader import load_recording
from orientd.recorder.tables import export
from orientd.recorder.writer import RecordingWriter
from orientd.stream.records import CycleFlag, ServoState

VECTORS = {"omega_body": "_rad_s", "alpha_body": "_rad_s2", "position": "_m"}
PLAIN = (
    "time_s deadline_ns lateness_s work_s state fault is_written speed path_time_s index motion "
)
PLAIN += "overruns missed planned_qw planned_qx planned_qy planned_qz"


@pytest.fixture(scope="module")
def cycles():
    table = moving(60, joints=2)
    table["flags"][10:20] = CycleFlag.FEEDBACK
    table["flags"][20:30] = CycleFlag.WRITTEN
    table["state"][:5], table["fault"][:5] = ServoState.FAULT, Fault.LINK_LOST
    table["overruns"], table["missed"], table["speed"] = np.arange(60), 7, 0.5
    table["planned_q"][20:30] = np.nan
    return table


@pytest.fixture(scope="module")
def recording(cycles, tmp_path_factory):
    path = tmp_path_factory.mktemp("recording") / "a.mcap"
    with RecordingWriter(path, offset_ns=OFFSET_NS) as writer:
        writer.add_device("arm", RATE_HZ)
        writer.add_configuration("{}", {})
        writer.add_cycles("arm", cycles)
    return load_recording(path)


@pytest.fixture(scope="module")
def table(recording, tmp_path_factory):
    path = tmp_path_factory.mktemp("table") / "a.npz"
    assert export(recording, "arm", path) == 60
    with np.load(path) as opened:
        return dict(opened)


def test_the_columns_have_the_names_that_are_promised(table):
    names = PLAIN.split()
    for group in ("sent", "measured"):
        names += ["measured_time_s"] * (group == "measured")
        names += [f"{group}_q{axis}" for axis in "wxyz"]
        for quantity, unit in VECTORS.items():
            if (group, quantity) != ("measured", "alpha_body"):
                names += [f"{group}_{quantity}_{axis}{unit}" for axis in "xyz"]
        names += [f"{group}_joints_{axis}_rad" for axis in (1, 2)]
    assert list(table) == names


def test_times_are_in_seconds_of_the_day(table, cycles):
    np.testing.assert_allclose(table["time_s"], (cycles["deadline_ns"] + OFFSET_NS) * 1e-9)
    for name in ("lateness", "work"):
        np.testing.assert_allclose(table[f"{name}_s"], cycles[f"{name}_ns"] * 1e-9, rtol=1e-12)
    told = (cycles["flags"] & CycleFlag.FEEDBACK) != 0
    stamps = (cycles["feedback_time_ns"] + OFFSET_NS) * 1e-9
    np.testing.assert_allclose(table["measured_time_s"], np.where(told, stamps, np.nan))


def test_states_and_faults_are_names_and_counts_are_numbers(table, cycles):
    assert table["state"].tolist() == ["fault"] * 5 + ["streaming"] * 55
    assert table["fault"].tolist() == ["link_lost"] * 5 + ["none"] * 55
    assert table["is_written"].tolist() == [True] * 10 + [False] * 10 + [True] * 40
    for name in ("index", "motion", "overruns", "missed", "deadline_ns", "speed"):
        np.testing.assert_array_equal(table[name], cycles[name])


@pytest.mark.parametrize("group", ["sent", "measured"])
def test_quantities_are_component_by_component(table, cycles, group):
    is_there = (
        (cycles["flags"] & CycleFlag.FEEDBACK) != 0 if group == "measured" else np.full(60, 1)
    )
    for quantity, components, unit in (
        ("q", "wxyz", ""), ("omega_body", "xyz", "_rad_s"), ("position", "xyz", "_m"),
        ("joints", "12", "_rad"),
    ):  # fmt: skip
        for k, axis in enumerate(components):
            name = f"{group}_{quantity}{'' if quantity == 'q' else '_'}{axis}{unit}"
            expected = np.where(is_there, cycles[f"{group}_{quantity}"][:, k], np.nan)
            np.testing.assert_allclose(table[name], expected, atol=1e-6, err_msg=name)


def test_in_a_csv_a_missing_number_is_empty(recording, table, tmp_path):
    assert export(recording, "arm", tmp_path / "a.csv") == 60
    with (tmp_path / "a.csv").open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert len(rows) == 60
    assert rows[25]["measured_qw"] == rows[25]["planned_qw"] == rows[25]["measured_time_s"] == ""
    for name, column in table.items():
        told = [row[name] for row in rows]
        assert told == ["" if one != one else str(one) for one in column.tolist()]
