"""Cycles of a device that moves, with noise in what is measured, and what others read of them."""

import numpy as np
from google.protobuf.unknown_fields import UnknownFieldSet
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory
from mcap_ros2.decoder import DecoderFactory as Ros2DecoderFactory

from orientd import rotation
from orientd.recorder.columns import CYCLES, SCHEMA_NAME
from orientd.stream.records import CycleFlag, ServoState

RATE_HZ = 500.0
OFFSET_NS = 1_700_000_000_000_000_000


def moving(count, *, first=0, joints=0, noise=1.0, seed=1):
    """Return *count* cycles of a device on its way, *joints* axes measured."""
    rng = np.random.default_rng(seed)
    index = first + np.arange(count)
    t = index / RATE_HZ
    sway = np.array([[0.6, 1.3, 0.0], [0.5, 0.9, 1.0], [1.2, 0.7, 2.0]])
    size, rate, phase = (sway[:, k][None] for k in range(3))
    angles = rate * t[:, None] + phase
    r, rates = size * np.sin(angles), size * rate * np.cos(angles)
    omega = (rotation.right_jacobian(r) @ rates[..., None])[..., 0]
    table = np.zeros(count, CYCLES)
    table["index"] = index
    table["deadline_ns"] = 5_000_000_000 + 2_000_000 * index
    table["lateness_ns"] = rng.gamma(2.0, 15e3, count)
    table["work_ns"] = rng.gamma(9.0, 20e3, count)
    age = 1_000_000 + rng.gamma(2.0, 50e3, count).astype(np.int64)
    table["feedback_time_ns"] = table["deadline_ns"] - age
    table["path_index"] = index + 500
    table["state"], table["motion"], table["speed"] = ServoState.STREAMING, 1, 1.0
    table["flags"] = CycleFlag.FEEDBACK | CycleFlag.WRITTEN
    table["sent_q"], table["sent_omega_body"] = rotation.exp(r), omega
    table["planned_q"] = table["sent_q"]
    table["sent_alpha_body"] = np.gradient(omega, 1.0 / RATE_HZ, axis=0)
    table["sent_position"] = 0.1 * np.sin(angles)
    table["measured_q"] = rotation.multiply(
        rotation.exp(r), rotation.exp(1e-5 * noise * rng.normal(size=(count, 3)))
    )
    table["measured_omega_body"] = omega + 1e-3 * noise * rng.normal(size=(count, 3))
    table["measured_position"] = table["sent_position"] + 1e-5 * noise * rng.normal(size=(count, 3))
    table["measured_joints"] = table["sent_joints"] = np.nan
    for axis in range(joints):
        table["sent_joints"][:, axis] = r[:, axis % 3]
        table["measured_joints"][:, axis] = r[:, axis % 3] + 1e-5 * noise * rng.normal(size=count)
    return table


def decoded(path):
    """Yield topic, schema, log time and message of everything in a file."""
    with path.open("rb") as stream:
        by_schema = make_reader(stream, decoder_factories=[DecoderFactory(), Ros2DecoderFactory()])
        for schema, channel, message, content in by_schema.iter_decoded_messages():
            yield channel.topic, schema.name, message.log_time, content


def validated(path):
    """Check that every message decodes by the schema in the file; return how many, by topic."""
    counts = {}
    for topic, schema, _, content in decoded(path):
        if schema != SCHEMA_NAME:
            assert content.DESCRIPTOR.full_name == schema
            assert len(UnknownFieldSet(content)) == 0
        counts[topic] = counts.get(topic, 0) + 1
    return counts
