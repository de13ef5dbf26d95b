"""The way of a keyframe from its file to the wire is short: see ``orientd/schema/DECISION.md``."""

import sys
from pathlib import Path

import orientd
from orientd import motion_file
from orientd.rpc.motion import from_request, to_request

ROOT = str(Path(orientd.__file__).parent)
MOST_FUNCTIONS = 40
MOST_TYPES = 12

MOTION = """
keyframes:
  - {quaternion: {w: 1, x: 0, y: 0, z: 0}, time: 0}
  - {quaternion: {w: 0.8, x: 0.6, y: 0, z: 0}, time: 2.0}
"""


def passed(work):
    """Return what *work* returns, the named functions that it calls, and the types it sees."""
    functions, types = set(), set()

    def note(value):
        if type(value).__module__.startswith("orientd"):
            types.add(type(value).__qualname__)
        elif isinstance(value, (list, tuple, dict)):
            for one in value.values() if isinstance(value, dict) else value:
                note(one)

    def trace(frame, event, returned):
        code = frame.f_code
        if code.co_filename.startswith(ROOT) and event in ("call", "return"):
            if not code.co_name.startswith("<"):
                functions.add(f"{Path(code.co_filename).stem}.{code.co_qualname}")
            note([*frame.f_locals.values(), returned])

    sys.setprofile(trace)
    try:
        result = work()
    finally:
        sys.setprofile(None)
    return result, functions, types


def test_a_keyframe_passes_few_functions_and_types_from_file_to_wire(tmp_path):
    path = tmp_path / "motion.yaml"
    path.write_text(MOTION, encoding="utf-8")
    request = to_request(from_request(motion_file.load(path)))  # with what is done once only
    message, functions, types = passed(lambda: from_request(motion_file.load(path)))
    assert {"motion_file.load", "motion.from_request"} <= functions
    assert {"Keyframe", "MotionRequest"} <= types
    assert len(functions) <= MOST_FUNCTIONS, sorted(functions)
    assert len(types) <= MOST_TYPES, sorted(types)
    assert to_request(message) == request
