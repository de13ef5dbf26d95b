"""Plan random requests by their numbers, and print a fingerprint of what came of each as JSON.

``python bits.py NUMBER...`` plans them in this order.
"""

import hashlib
import json
import random
import sys
from dataclasses import replace

from motions import read
from wild import wild_motion

from orientd.curves import METHODS
from orientd.errors import OrientdError
from orientd.model.limits import DEFAULT_LIMITS
from orientd.planner.planning import plan
from orientd.planner.state import State

PERIOD = 0.002
NEAREST = 1e-2
"""rad between keyframes; some motions through nearer ones have a million records."""
ELSEWHERE = [{"quaternion": {"w": 0.0, "x": 0.6, "y": 0.0, "z": 0.8}}]
FAMILIES = list(METHODS)


def fingerprint(number):
    """Return what came of request *number*, which begins at rest or within another motion."""
    chance = random.Random(number)
    start = State.at_rest((1.0, 0.0, 0.0, 0.0))
    if chance.random() < 0.4:
        first = planned(ELSEWHERE, {}, start)
        start = first.state_at(chance.randrange(first.record_count))
    keyframes, fields = wild_motion(chance, [FAMILIES[number % len(FAMILIES)]], nearest=NEAREST)
    try:
        motion = planned(keyframes, fields, start)
    except OrientdError as error:
        return [f"{type(error).__name__}: {error}"]
    records = motion.records(0, motion.record_count)
    return [
        hashlib.sha256(records.tobytes()).hexdigest(),
        *(time.hex() for time in motion.keyframe_times.tolist()),
        *(time.hex() for time in (motion.duration, motion.start_time, motion.end_time)),
        repr(motion.certificate),
    ]


def planned(keyframes, fields, start):
    request = read(keyframes, **fields)
    equal = replace(DEFAULT_LIMITS)  # every caller has its own
    return plan(request, start=start, limits=equal, period=PERIOD, motion_id="same")


if __name__ == "__main__":
    print(json.dumps({number: fingerprint(int(number)) for number in sys.argv[1:]}))
