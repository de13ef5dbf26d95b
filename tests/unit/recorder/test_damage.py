"""Recordings that are cut or damaged: never taken for whole, and what is whole of them."""

import os
import tracemalloc

import numpy as np
import pytest
from command_line import assert_refused, inside
from mcap.writer import CompressionType, Writer
from recorded import OFFSET_NS, RATE_HZ, moving

from orientd.protocol import control_pb2 as pb
from orientd.recorder.mcap_file import LARGEST_CHUNK, Damages, records
from orientd.recorder.reader import load_recording
from orientd.recorder.writer import RecordingError, RecordingWriter
from orientd_replay.orientations import read_orientations

CASES = int(os.environ.get("ORIENTD_CASES", "12"))
COUNT = 600
TAIL = 4096


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """A recording of a motion of 4 s that goes on where it ends, as bytes, and its cycles."""
    path, table = tmp_path_factory.mktemp("whole") / "whole.mcap", moving(COUNT)
    began = pb.Event(
        device="arm",
        kind=pb.EVENT_KIND_MOTION_STARTED,
        motion_number=1,
        time_ns=int(table["deadline_ns"][0]),
        plan=pb.Plan(certificate=pb.Certificate(duration=4.0)),
    )
    with RecordingWriter(path, offset_ns=OFFSET_NS) as writer:
        writer.add_device("arm", RATE_HZ)
        writer.add_configuration("{}", {})
        writer.add_event(began)
        for first in range(0, COUNT, 25):
            writer.add_cycles("arm", table[first : first + 25])
            writer.flush()
    return path.read_bytes(), load_recording(path).cycles["arm"]


def refusal(path):
    """Return in which words a recording is refused."""
    with pytest.raises(RecordingError) as refused:
        read_orientations(path)
    assert "\n" not in str(refused.value)
    assert "Error" not in str(refused.value)
    return str(refused.value)


def rest(path, cycles):
    """Return how many cycles are had of a damaged recording, each as it was."""
    try:
        recording = load_recording(path, partial=True)
    except RecordingError:
        return 0
    assert recording.damages
    found = recording.cycles.get("arm", cycles[:0])
    assert found.tobytes() == cycles[: len(found)].tobytes()  # joints are no numbers
    return len(found)


@pytest.mark.timeout(1200)  # with 300 cases there are 4,300 cuts
def test_a_recording_that_was_cut_is_never_taken_for_whole(whole, tmp_path):
    content, cycles = whole
    random, path = np.random.default_rng(1), tmp_path / "cut.mcap"
    anywhere = random.integers(0, len(content), min(CASES, 200)).tolist()
    at_the_end = range(len(content) - TAIL, len(content))
    if CASES < 300:
        at_the_end = random.choice(at_the_end, CASES).tolist()
    before = 0
    for size in sorted({0, 7, 8, *anywhere, *at_the_end, len(content) - 1}):
        path.write_bytes(content[:size])
        words = refusal(path)
        assert any(part in words for part in ("no end", "cut off", "MCAP file", "index")), words
        had = rest(path, cycles)
        assert had >= before
        before = had
    assert before == COUNT


def test_it_is_said_how_far_a_cut_recording_reaches_and_what_is_missing(whole, tmp_path):
    content, cycles = whole
    path = tmp_path / "cut.mcap"
    path.write_bytes(content[: len(content) // 2])
    words = refusal(path)
    with pytest.raises(RecordingError, match="it has no end"):
        load_recording(path)
    recording = load_recording(path, partial=True)
    reached = float(recording.cycles["arm"]["deadline_ns"][-1] - cycles["deadline_ns"][0]) * 1e-9
    count = recording.damages.reached
    assert len(content) // 2 - 20_000 < count < len(content) // 2
    assert words == (
        f"{path} is not whole: it has no end: it can be read to {reached:.3f} s ({count} of "
        f"{len(content) // 2} bytes); motion 1 of arm was to go on for about {4.0 - reached:.3f} "
        "s; `--partial` (in Python `partial=True`) takes what can be read; "
        f"`mcap recover {path} -o NEW.mcap` makes a whole file of it"
    )
    found = read_orientations(path, partial=True)
    assert len(found.times) == len(recording.cycles["arm"])
    assert any("it has no end" in note for note in found.notes)


def test_a_file_is_read_up_to_a_flipped_bit_and_its_place_is_named(whole, tmp_path):
    content, cycles = whole
    path = tmp_path / "flipped.mcap"
    place = content.index(b"zstd", len(content) // 2) + 200  # inside of a chunk
    path.write_bytes(flipped(content, [place]))
    words = refusal(path)
    count = rest(path, cycles)
    reached = float(cycles["deadline_ns"][count - 1] - cycles["deadline_ns"][0]) * 1e-9
    before = load_recording(path, partial=True).damages.reached
    assert place - 20_000 < before < place
    assert (
        f"it is damaged: it can be read to {reached:.3f} s ({before} of {len(content)} b" in words
    )
    assert f"motion 1 of arm was to go on for about {4.0 - reached:.3f} s" in words
    assert f"`mcap recover {path} -o NEW.mcap` passes over damaged chunks" in words
    assert 200 < count < 400


def test_random_flipped_bits_are_named_or_harmless(whole, tmp_path):
    content, cycles = whole
    random, path, harmless = np.random.default_rng(2), tmp_path / "flipped.mcap", 0
    for _ in range(CASES):
        damaged = bytearray(content)
        for place in random.integers(8, len(content), int(random.integers(1, 4))).tolist():
            damaged[place] ^= 1 << int(random.integers(8))
        path.write_bytes(damaged)
        try:
            recording = load_recording(path)
        except RecordingError:
            refusal(path)
            rest(path, cycles)
        else:
            harmless += 1
            assert recording.cycles["arm"].tobytes() == cycles.tobytes()
    print(f"{harmless} of {CASES} harmless")


def flipped(content, places):
    damaged = bytearray(content)
    for place in places:
        damaged[place] ^= 4
    return bytes(damaged)


def chunk_places(content):
    """Return a place inside of the content of each chunk."""
    places, at = [], content.find(b"zstd")
    while at >= 0:
        if content[at - 41] == 6:
            places.append(at + 100)
        at = content.find(b"zstd", at + 1)
    return places


def test_without_the_first_chunk_nothing_can_be_read(whole, tmp_path):
    content, cycles = whole
    path, first = tmp_path / "flipped.mcap", chunk_places(content)[0]
    assert len(chunk_places(content)) == COUNT // 25
    path.write_bytes(flipped(content, [first]))
    words = refusal(path)
    assert f"it is damaged: no message in its {len(content)} bytes can be read" in words
    assert "passes over damaged chunks" in words
    assert rest(path, cycles) == 0
    path.write_bytes(content[:first])
    words = refusal(path)
    assert f"it has no end: no message in its {first} bytes can be read" in words
    assert "mcap recover" not in words


def test_a_file_that_ends_between_two_records_has_no_end_and_no_damage(whole, tmp_path):
    content, _ = whole
    damages, path = Damages(), tmp_path / "cut.mcap"
    path.write_bytes(content[: chunk_places(content)[3] - 100 - 41])
    list(records(path, damages))
    assert damages.is_cut
    assert damages.reached == damages.size
    path.write_bytes(content[:8])
    assert "no message in its 8 bytes can be read" in refusal(path)


def test_a_chunk_that_grows_beyond_all_measure_is_refused(tmp_path):
    path = tmp_path / "bomb.mcap"
    for size, is_refused in ((LARGEST_CHUNK - 10_000, False), (LARGEST_CHUNK + 1, True)):
        with path.open("wb") as stream:
            writer = Writer(stream, chunk_size=2 * LARGEST_CHUNK)
            writer.start()
            channel = writer.register_channel("/a", "json", 0)
            writer.add_message(channel, log_time=1, data=bytes(size), publish_time=1)
            writer.finish()
        if is_refused:
            with pytest.raises(RecordingError, match="a chunk becomes 64 MiB"):
                list(records(path, Damages()))
        else:
            assert list(records(path, Damages()))


def test_many_chunks_that_grow_beyond_all_measure_are_refused(tmp_path):
    path = tmp_path / "bomb.mcap"
    with path.open("wb") as stream:
        writer = Writer(stream, chunk_size=1)
        writer.start()
        channel = writer.register_channel("/a", "json", 0)
        for _ in range(4):
            writer.add_message(channel, log_time=1, data=bytes(LARGEST_CHUNK // 3), publish_time=1)
        writer.finish()
    with pytest.raises(RecordingError, match="a chunk becomes 21 MiB"):
        list(records(path, Damages()))


@pytest.mark.parametrize("compression", ["zstd", "lz4"])
def test_a_chunk_that_grows_beyond_its_word_takes_no_memory(tmp_path, compression):
    path = tmp_path / "bomb.mcap"
    with path.open("wb") as stream:
        writer = Writer(
            stream, chunk_size=LARGEST_CHUNK, compression=CompressionType[compression.upper()]
        )
        writer.start()
        channel = writer.register_channel("/a", "json", 0)
        writer.add_message(channel, log_time=1, data=bytes(LARGEST_CHUNK // 2), publish_time=1)
        writer.finish()
    content = bytearray(path.read_bytes())
    name = content.index(compression.encode())
    content[name - 16 : name - 8] = (1000).to_bytes(8, "little")
    path.write_bytes(content)
    damages = Damages()
    tracemalloc.start()
    try:
        list(records(path, damages))
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert damages.is_short
    assert peak < LARGEST_CHUNK // 16


def test_commands_refuse_a_cut_recording_in_one_line_and_take_what_is_whole_when_asked(
    whole, tmp_path
):
    content, _ = whole
    path = tmp_path / "cut.mcap"
    path.write_bytes(content[: len(content) // 2])
    for command in (
        ("replay", path, "--dry-run"),
        ("plot", path, "-o", tmp_path / "a.svg"),
        ("export", path, "-o", tmp_path / "a.csv"),
    ):
        assert_refused(inside(*command), "is not whole: ", "it has no end", "`--partial`")
        done = inside(*command, "--partial")
        assert done.returncode == 0, done.stderr
        assert "it has no end: it can be read to" in done.stdout
        assert f"`mcap recover {path} -o NEW.mcap` makes a whole file of it" in done.stdout


def test_a_head_without_a_cycle_is_named_as_such(whole, tmp_path):
    content, _ = whole
    path = tmp_path / "head.mcap"
    path.write_bytes(content[:300])
    problem = f"{path}: no cycle of a device in it; it has no end: no message in its 300 bytes can"
    assert_refused(inside("export", path, "--partial", "-o", tmp_path / "a.csv"), problem)
    assert_refused(inside("plot", path, "--partial", "-o", tmp_path / "a.svg"), problem)
    done = inside("replay", path, "--partial", "--dry-run")
    problem = (
        f"{path}: no topics in it, expected one of orientations; record it again; it has no end"
    )
    assert_refused(done, f"{problem}: no message in its 300 bytes")
