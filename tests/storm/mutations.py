"""Damaged files of every kind that is read, made of whole ones, and what each of them comes to."""

import json
import re
import zipfile
from pathlib import Path

import numpy as np
from mcap.records import Attachment, Channel, Message, Metadata, Schema
from mcap.writer import CompressionType, Writer
from recorded import OFFSET_NS, RATE_HZ, moving
from scipy.spatial.transform import Rotation
from test_bags import humble

import orientd
from orientd import config, motion_file
from orientd.errors import OrientdError
from orientd.protocol import control_pb2 as pb
from orientd.recorder.mcap_file import Damages, records
from orientd.recorder.planned import marks
from orientd.recorder.reader import load_recording
from orientd.recorder.tables import columns
from orientd.recorder.writer import RecordingWriter
from orientd_replay.orientations import read_orientations

MOST_MIB = 300
CONFIG = Path(__file__).parents[2] / "config"
NUMBER = re.compile(rb"[-+]?\d+(\.\d+)?")
WILD = (
    *(b"1e309", b"-1e300", b"nan", b"0", b"-0.0", b"9" * 400, b"9" * 5000, b"true", b"''", b"[]"),
    *(
        b"{}",
        b"*a",
        b"&a ",
        b"1e-320",
        b"2026-01-01",
        b"2147483647",
        b"\x00",
        b"\x1b[2J",
        b"[" * 99,
    ),
)
EXTREMES = (b"\x00" * 8, b"\xff" * 8, b"\xff" * 4, b"\x7f\xff\xff\xff", b"\xff\xff\xff\x7f")


def seeds(folder):
    """Write a whole file of every kind that is read and return them."""
    keyframes = [{"rotation_vector": [0, 0, 0.2 * k], "time": 0.5 * k} for k in range(5)]
    motion = {"keyframes": keyframes, "limits": {"velocity": [1, 2, 2.5]}, "approach": True}
    times = 0.02 * np.arange(40)
    q = np.stack([np.cos(times), np.sin(times), 0 * times, 0 * times], axis=-1)
    rows = "\n".join(",".join(map(repr, row)) for row in np.c_[times, q].tolist())
    for name, text in {
        "motion.json": json.dumps(motion, indent=1),
        "motions.jsonl": "\n".join([json.dumps(motion)] * 3),
        "recorded.csv": f"time_s,qw,qx,qy,qz\n{rows}\n",
    }.items():
        (folder / name).write_text(text)
    for name in ("ur-turn.yaml", "gimbal-turn.yaml", "loopback.toml", "ur.toml", "gimbal.toml"):
        (folder / name).write_bytes((CONFIG / name).read_bytes())
    _record(folder / "packed.mcap")
    _unpack(folder / "packed.mcap", folder / "plain.mcap")
    _poses(folder / "poses.mcap", times, q)
    humble(folder / "bag.db3")
    orientd.plan(Rotation.from_rotvec(np.outer([0, 1, 2], [0, 0, 0.1]))).save(folder / "saved.npz")
    return sorted(folder.iterdir())


def _record(path):
    event = pb.Event(device="arm", kind=pb.EVENT_KIND_MOTION_STARTED, motion_number=1)
    event.time_ns = 5_000_000_000
    for k in range(5):
        sample = event.samples.add(path_time=0.1 * k)
        sample.q.w = 1.0
    with RecordingWriter(path, offset_ns=OFFSET_NS) as writer:
        writer.add_device("arm", RATE_HZ)
        writer.add_configuration('{"devices": {}}', {})
        writer.add_event(event)
        writer.add_cycles("arm", moving(60, joints=2))


def _unpack(source, path):
    """Write a recording without compression and checksums, so that damage gets past them."""
    with path.open("wb") as stream:
        writer = Writer(stream, compression=CompressionType.NONE, enable_crcs=False)
        writer.start()
        seen = set()
        for record in records(source, Damages()):
            # Numbers come again in the same order; the end of a file repeats what begins it.
            if isinstance(record, Schema | Channel):
                if (type(record), record.id) in seen:
                    continue
                seen.add((type(record), record.id))
            if isinstance(record, Schema):
                writer.register_schema(record.name, record.encoding, record.data)
            elif isinstance(record, Channel):
                writer.register_channel(record.topic, record.message_encoding, record.schema_id)
            elif isinstance(record, Message):
                time = record.log_time
                writer.add_message(record.channel_id, time, record.data, time)
            elif isinstance(record, Metadata):
                writer.add_metadata(record.name, record.metadata)
            elif isinstance(record, Attachment):
                writer.add_attachment(0, 0, record.name, record.media_type, record.data)
        writer.finish()


def _poses(path, times, q):
    """Write poses as JSON, as the recording of another program."""
    with path.open("wb") as stream:
        writer = Writer(stream, compression=CompressionType.NONE, enable_crcs=False)
        writer.start()
        schema = writer.register_schema("Pose", "jsonschema", b"{}")
        channel = writer.register_channel("/pose", "json", schema)
        for time, row in zip(times, q.tolist(), strict=True):
            content = {"orientation": dict(zip("wxyz", row, strict=True)), "stamp": float(time)}
            writer.add_message(channel, int(1e9 * time), json.dumps(content).encode(), 0)
        writer.finish()


def damaged(content, chance):
    """Return *content* with a few kinds of damage, at random."""
    for _ in range(chance.choice((1, 1, 1, 2, 5))):
        at = chance.randrange(len(content) + 1)
        end = min(len(content), at + chance.choice((1, 2, 8, 60, 400)))
        numbers = list(NUMBER.finditer(content[:20_000]))
        match chance.randrange(9):
            case 0:
                content = content[:at]
            case 1:
                content = content[:at] + content[end:]
            case 2:
                content = content[:end] + content[at:]
            case 3:
                content = content[:at] + chance.randbytes(end - at) + content[end:]
            case 4:
                extreme = chance.choice(EXTREMES)
                content = content[:at] + extreme + content[at + len(extreme) :]
            case 5:
                content = content[:at] + chance.choice(WILD) + content[at:]
            case 6 | 7 if numbers:
                number = chance.choice(numbers)
                content = content[: number.start()] + chance.choice(WILD) + content[number.end() :]
            case _ if content:
                at = min(at, len(content) - 1)
                flipped = bytes([content[at] ^ 1 << chance.randrange(8)])
                content = content[:at] + flipped + content[at + 1 :]
    return content


def damaged_file(source, path, chance):
    """Write a damaged copy of *source*; of an archive, often one whose checksums are right."""
    if source.suffix != ".npz" or chance.random() < 0.2:
        path.write_bytes(damaged(source.read_bytes(), chance))
        return
    with zipfile.ZipFile(source) as whole, zipfile.ZipFile(path, "w") as archive:
        hit = chance.choice(whole.namelist())
        for name in whole.namelist():
            content = whole.read(name)
            archive.writestr(name, damaged(content, chance) if name == hit else content)


def read(path):
    """Read a file in every way that its kind is read, one after the other."""
    if path.suffix == ".toml":
        yield lambda: config.load(path)
    elif path.suffix == ".npz":
        yield lambda: orientd.load_motion(path).sample([0.1])
    elif path.stem == "motions":
        yield lambda: [motion_file.loads(one, "one.json") for one in path.read_bytes().splitlines()]
    elif path.suffix in (".yaml", ".json"):
        yield lambda: motion_file.load(path)
    else:
        yield lambda: read_orientations(path)
    if path.suffix == ".mcap" and path.stem != "poses":
        yield lambda: read_orientations(path, "/arm/sent")
        yield lambda: _tabulate(load_recording(path))


def _tabulate(recording):
    name = recording.device()
    columns(recording, name)
    marks(recording, name)


def peak_mib():
    """Return the most memory that this process has had since :func:`forget_peak`."""
    (line,) = [x for x in Path("/proc/self/status").read_text().splitlines() if "VmHWM" in x]
    return int(line.split()[1]) / 1024


def forget_peak():
    Path("/proc/self/clear_refs").write_text("5")


def check(path):
    """Return whether a file was read; check that it was refused in one line if it was not."""
    is_read = True
    for way in read(path):
        forget_peak()
        before = peak_mib()
        try:
            way()
        except OrientdError as error:
            is_read = False
            said = str(error)
            assert said
            assert len(said) <= 1000, said
        # Whatever else this process keeps is not of the file.
        assert peak_mib() - before < MOST_MIB
    return is_read
