"""Call every kernel with tables that no caller of ours makes, and see that it comes back.

``python fuzz.py CASES SEED [KERNEL ...]`` records the calls of some plans and curves, then repeats
each with its numbers and shapes spoilt.  Any answer is right, as long as the kernel answers: within
LONGEST seconds of the processor, without reading or writing outside its arrays, which the
sanitizers of ``make sanitize`` watch.  The file that ``ORIENTD_FUZZ_LOG`` names holds the call at
hand.
"""

from __future__ import annotations

import faulthandler
import os
import random
import signal
import sys
import types
from array import array
from typing import Any

import numpy as np

from orientd import kernels

LONGEST = 20.0
"""Time of the processor that a call may take, spoilt or not, with the sanitizers, s."""

MOST_RECORDED = 12
"""Calls of each kernel that are kept to be spoilt."""

NUMBERS = (np.nan, np.inf, -np.inf, 0.0, -0.0, 1e308, -1e308, 5e-324, 1e-18, 1e18, -1.0, 0.5)
COUNTS = (0, 1, 2, 3, 7, -1, -(2**31), 2**31, 2**62, -(2**63), 2**63 - 1)

recorded: dict[str, list[tuple[Any, ...]]] = {}


def record() -> None:
    """Have every kernel keep what it is called with."""
    for name, kernel in vars(kernels).copy().items():
        if isinstance(kernel, types.BuiltinFunctionType):
            setattr(kernels, name, recorder(name, kernel))


def recorder(name, kernel):
    """Return a function that calls *kernel* and keeps copies of its arguments."""
    kept = recorded.setdefault(name, [])

    def call(*arguments):
        if len(kept) < MOST_RECORDED or random.random() < 0.02:
            copies = tuple(
                np.array(a) if isinstance(a, np.ndarray | array | memoryview) else a
                for a in arguments
            )
            if len(kept) < MOST_RECORDED:
                kept.append(copies)
            else:
                kept[random.randrange(MOST_RECORDED)] = copies
        return kernel(*arguments)

    call.kernel = kernel
    return call


def work() -> None:
    """Make curves of every family and plan some motions, which call every kernel."""
    from calls import make_calls

    make_calls()


def spoilt(value: Any, chance: random.Random) -> Any:
    """Return an argument with something wrong with it, or as it is."""
    if isinstance(value, np.ndarray):
        return spoilt_array(value, chance)
    if isinstance(value, bool) or chance.random() < 0.7:
        return value
    if isinstance(value, int):
        return chance.choice(COUNTS)
    return float(chance.choice(NUMBERS))


def spoilt_array(array: np.ndarray, chance: random.Random) -> np.ndarray:
    """Return a copy of an array with spoilt numbers, or with another shape."""
    array = array.copy()
    what = chance.random()
    if what < 0.5:
        return array
    if what < 0.8 and array.size:
        flat = array.reshape(-1)
        pool = COUNTS if array.dtype == np.int64 else NUMBERS
        for _ in range(chance.choice([1, 1, 2, 5, array.size])):
            flat[chance.randrange(array.size)] = chance.choice(pool)
        return array
    if what < 0.85:
        return np.ascontiguousarray(array[::-1])
    if what < 0.95:
        axis = chance.randrange(array.ndim)
        kept = chance.randrange(array.shape[axis] + 1)
        return np.ascontiguousarray(array.take(range(kept), axis=axis))
    axis = chance.randrange(array.ndim)
    return np.ascontiguousarray(np.concatenate([array, array], axis=axis))


def main(cases: int, seed: int, only: list[str]) -> None:
    """Repeat the recorded calls spoilt, *cases* times each kernel, or each of those named."""
    # Of the processor's time, which a busy machine does not make longer; then it ends the process.
    faulthandler.register(signal.SIGVTALRM, chain=True)
    chance = random.Random(seed)
    random.seed(seed)  # which calls are kept
    record()
    work()
    silent = [name for name, calls in recorded.items() if not calls]
    if silent:
        print(f"no call was recorded of {', '.join(silent)}: add one to calls.py")
    log = os.open(os.environ.get("ORIENTD_FUZZ_LOG", os.devnull), os.O_CREAT | os.O_WRONLY)
    refused = 0
    tried = {name: recorded[name] for name in only} or recorded
    for name, calls in tried.items():
        kernel = getattr(kernels, name).kernel
        for case in range(cases if calls else 0):
            arguments = tuple(spoilt(value, chance) for value in chance.choice(calls))
            os.pwrite(log, f"{name} {case}\n".ljust(80).encode(), 0)
            signal.setitimer(signal.ITIMER_VIRTUAL, LONGEST)
            try:
                kernel(*arguments)
            except (ValueError, TypeError, MemoryError, OverflowError):
                refused += 1
            signal.setitimer(signal.ITIMER_VIRTUAL, 0.0)
    print(f"{len(tried)} kernels, {cases} calls each: {refused} refused, all came back")


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]), sys.argv[3:])
