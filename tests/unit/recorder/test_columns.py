"""The cycles of a recording are those of the servo, by a schema that others read."""

import numpy as np
import pytest
from mcap.records import Schema
from mcap_ros2.decoder import DecoderFactory
from recorded import moving

from orientd import rotation
from orientd.errors import Fault
from orientd.recorder.columns import (
    COLUMNS,
    CYCLES,
    SCHEMA_NAME,
    Layout,
    from_records,
    schema,
    to_messages,
)
from orientd.stream.records import CYCLE_RECORD, CycleFlag, ServoState, unpack_cycle

PAIRS = (
    ("sent_q", "q"),
    ("sent_alpha_body", "alpha_body"),
    ("sent_position", "position"),
    ("measured_q", "feedback_q"),
    ("measured_joints", "joints"),
    ("sent_joints", "sent_joints"),
    ("planned_q", "planned_q"),
)

COARSEST = {
    "planned_q": 1e-10, "sent_q": 1e-10, "sent_omega_body": 1e-8, "sent_alpha_body": 1e-6,
    "sent_position": 1e-9,
    "measured_q": 1e-8, "measured_omega_body": 1e-6, "measured_position": 1e-7,
    "measured_joints": 1e-8, "sent_joints": 1e-8, "path_fraction": 1e-9, "speed": 1e-9,
}  # fmt: skip
"""Resolution that the reference promises, in SI units."""


def others_read(table):
    """Return the messages of *table* as the ROS 2 decoder of the MCAP project reads them."""
    text = schema().encode()
    told = Schema(id=1, name=SCHEMA_NAME, encoding="ros2msg", data=text)
    decode = DecoderFactory().decoder_for("cdr", told)
    return [decode(message) for message in to_messages(table)]


def back(table):
    return Layout(schema()).cycles(to_messages(table))


def parts(vector):
    return [getattr(vector, axis) for axis in ("wxyz" if hasattr(vector, "w") else "xyz")]


def check(found, table):
    for column in COLUMNS:
        if column.name:
            tolerance = 0.5 * COARSEST.get(column.name, 0.0)
            np.testing.assert_allclose(
                found[column.name], table[column.name], rtol=0, atol=tolerance, err_msg=column.name
            )


def test_a_row_is_the_servos_record_byte_for_byte():
    values = [*range(1, 7), ServoState.IDLE, *range(8, 13), *(0.5 * k for k in range(45))]
    record = CYCLE_RECORD.pack(*values)
    (row,), cycle = from_records(record), unpack_cycle(record)
    assert row["index"] == cycle.index
    assert row["feedback_time_ns"] == cycle.feedback_time_ns
    assert row["missed"] == cycle.missed
    for ours, theirs in PAIRS:
        assert tuple(row[ours]) == getattr(cycle, theirs)


@pytest.mark.parametrize("joints", [0, 3, 8])
def test_messages_give_back_every_number_to_the_resolution_promised(joints):
    table = moving(256, joints=joints)
    table["overruns"], table["missed"] = np.arange(256), 7
    table["path_fraction"] = np.linspace(0.0, 1.0, 256, endpoint=False)
    check(back(table), table)


def test_a_decoder_of_others_reads_every_quantity_by_its_name():
    table = moving(3, joints=2)
    table["path_fraction"], table["speed"], table["overruns"], table["missed"] = 0.25, 0.5, 4, 5
    for row, cycle in zip(table, others_read(table), strict=True):
        for name in ("index", "deadline_ns", "lateness_ns", "work_ns", "path_index", "motion",
                     "overruns", "missed", "path_fraction", "speed"):  # fmt: skip
            assert getattr(cycle, name) == row[name]
        assert cycle.measured.age_ns == row["deadline_ns"] - row["feedback_time_ns"]
        for group in ("sent", "measured"):
            told = getattr(cycle, group)
            for name in ("q", "omega_body", "position"):
                expected = row[f"{group}_{name}"]
                np.testing.assert_allclose(parts(getattr(told, name)), expected, atol=1e-6)
            np.testing.assert_allclose(told.joints, row[f"{group}_joints"], atol=1e-8)
        np.testing.assert_allclose(parts(cycle.planned.q), row["planned_q"], atol=1e-10)
        np.testing.assert_allclose(parts(cycle.sent.alpha_body), row["sent_alpha_body"], atol=1e-6)
        error = float(rotation.angle(row["sent_q"], row["measured_q"]))
        assert cycle.measured.tracking_error == pytest.approx(error, abs=1e-8)


def test_messages_are_as_ros_2_packs_them_byte_for_byte():
    typesys = pytest.importorskip("rosbags.typesys")
    store = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
    types = typesys.get_types_from_msg(schema(), SCHEMA_NAME)
    store.register({name: told for name, told in types.items() if name.startswith("orientd/")})
    table = moving(len(ServoState), joints=2)
    table["state"], table["fault"][::2] = list(ServoState), Fault.DEVICE_FAULT
    for message in to_messages(table):
        again = store.serialize_cdr(store.deserialize_cdr(message, SCHEMA_NAME), SCHEMA_NAME)
        assert bytes(again) == message


def test_states_and_faults_are_names():
    table = moving(len(ServoState))
    table["state"] = list(ServoState)
    assert [cycle.state for cycle in others_read(table)] == [
        "idle", "holding", "streaming", "stopping", "fault", "tracking"
    ]  # fmt: skip
    table = moving(len(Fault))
    table["fault"] = list(Fault)
    told = [cycle.fault for cycle in others_read(table)]
    assert told[:4] == ["none", "link_lost", "feedback_stale", "device_fault"]
    np.testing.assert_array_equal(back(table)["fault"], table["fault"])


def test_a_fault_of_a_later_version_keeps_its_number():
    table = moving(2)
    table["fault"] = 77
    assert others_read(table)[0].fault == "77"
    assert back(table)["fault"].tolist() == [77, 77]


def test_flags_are_truth_values():
    table = moving(5)
    table["flags"] = [0, 1, 2, 4, 8]
    told = [
        [one.has_feedback, one.is_written, one.is_from_rest, one.is_arriving]
        for one in others_read(table)
    ]
    assert told == [[k == row - 1 for k in range(4)] for row in range(5)]
    np.testing.assert_array_equal(back(table)["flags"], table["flags"])


def test_cycles_without_feedback_have_no_measurement():
    table = moving(20, joints=1)
    table["flags"][:10] = CycleFlag.WRITTEN
    found = back(table)
    assert np.all(found["feedback_time_ns"][:10] == 0)
    for name in ("measured_q", "measured_omega_body", "measured_position", "measured_joints"):
        assert np.isnan(found[name][:10]).all()
    check(found[10:], table[10:])
    assert np.isnan(others_read(table)[0].measured.tracking_error)


def test_what_is_not_finite_is_kept_as_it_is():
    table = moving(20)
    table["measured_q"][7] = np.nan
    table["sent_alpha_body"][3, 1] = np.inf
    table["measured_joints"][5:, 2] = 0.25
    found = back(table)
    assert np.isnan(found["measured_q"][7]).all()
    assert found["sent_alpha_body"][3, 1] == np.inf
    np.testing.assert_array_equal(found["measured_joints"], table["measured_joints"])


def test_no_cycles_are_no_messages():
    assert to_messages(np.zeros(0, CYCLES)) == []


def test_a_schema_of_another_version_is_read_by_its_names():
    text = schema()
    without = (
        text.replace("float64[8] joints\n", "")
        .replace("uint32 missed\n", "")
        .replace("bool is_arriving\n", "")
        .replace("orientd/Planned planned\n", "")
    )
    added = without.replace("int64 index\n", "int64 index\nfloat64 power_w\n")
    fixed = Layout(added).fixed
    rows = np.zeros(2, fixed)
    rows["index"], rows["sent.q"], rows["power_w"] = [4, 5], [0.0, 0.0, 0.6, 0.8], 3.0
    rows["is_written"] = True
    tail = b"\5\0\0\0idle\0\0\0\0\5\0\0\0none\0"
    messages = [b"\0\1\0\0" + row.tobytes() + tail for row in rows]
    found = Layout(added).cycles(messages)
    assert found["index"].tolist() == [4, 5]
    assert found["sent_q"].tolist() == [[0.8, 0.0, 0.0, 0.6]] * 2
    assert found["missed"].tolist() == [0, 0]
    assert found["flags"].tolist() == [CycleFlag.WRITTEN] * 2
    assert np.isnan(found["sent_joints"]).all()
    assert np.isnan(found["planned_q"]).all()
    with pytest.raises(ValueError, match="the unknown type 'lab/Thing' of thing"):
        Layout(f"lab/Thing thing\n{text}")


def test_fields_of_any_size_and_order_are_found_where_ros_2_puts_them():
    typesys = pytest.importorskip("rosbags.typesys")
    text = "bool is_written\nint64 index\nuint32 motion\nfloat64 speed\nbool has_feedback\n"
    text += "string fault\nstring state\n"
    store = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
    store.register(typesys.get_types_from_msg(text, SCHEMA_NAME))
    make = store.types[SCHEMA_NAME]
    told = [
        (True, 7, 3, 0.25, False, "link_lost", "fault"),
        (False, 8, 4, 1.0, True, "none", "idle"),
    ]
    messages = [bytes(store.serialize_cdr(make(*one), SCHEMA_NAME)) for one in told]
    found = Layout(text).cycles(messages)
    assert found["index"].tolist() == [7, 8]
    assert found["motion"].tolist() == [3, 4]
    assert found["speed"].tolist() == [0.25, 1.0]
    assert found["flags"].tolist() == [CycleFlag.WRITTEN, CycleFlag.FEEDBACK]
    assert found["fault"].tolist() == [Fault.LINK_LOST, Fault.NONE]
    assert found["state"].tolist() == [ServoState.FAULT, ServoState.IDLE]


def test_every_quantity_has_its_meaning_and_unit_in_the_schema():
    lines = schema().splitlines()
    fields = [k for k, line in enumerate(lines) if line and line[0] != "#" and " " in line]
    documented = {lines[k] for k in fields if lines[k - 1].startswith("# ")}
    bare = {lines[k] for k in fields} - documented
    groups = {"orientd/Planned", "orientd/Sent", "orientd/Measured"}
    assert {line.split()[0] for line in bare} <= groups | {"float64", "MSG:"}
    assert "# Angular velocity, body frame, rad/s." in lines
