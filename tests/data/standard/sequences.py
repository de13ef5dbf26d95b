"""The standard test set: named sequences of orientations, and the motion files made of them.

`python tests/data/standard/sequences.py` writes the files beside this one.  They are the data; this
says how they came about, and makes the same files again.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[3] / "docs"))
from generators.papers.scenes import boomerang_task, samples_of_ideal

from orientd.rotation import exp, from_euler, multiply

HERE = Path(__file__).parent
Content = dict[str, object]


def walk(steps, start=(1.0, 0.0, 0.0, 0.0)):
    """Return orientations, each from the one before by a rotation vector in the body frame."""
    keys = [np.array(start)]
    for step in steps:
        keys.append(multiply(keys[-1], exp(np.asarray(step, dtype=float))))
    return np.array(keys)


def random_steps(rng, lengths):
    """Return rotation vectors of given lengths about random axes."""
    axes = rng.normal(size=(len(lengths), 3))
    return axes / np.linalg.norm(axes, axis=1)[:, None] * np.asarray(lengths)[:, None]


def spread() -> Content:
    """Ten orientations 90 degrees apart about random axes, one a second."""
    rng = np.random.default_rng(1)
    return {"keys": walk(random_steps(rng, np.full(9, 0.5 * np.pi))), "times": np.arange(10.0)}


def clustered() -> Content:
    """Four clusters of three orientations 4 degrees apart, 70 degrees from one to the next."""
    rng = np.random.default_rng(2)
    lengths = np.radians([4, 4, 70, 4, 4, 70, 4, 4, 70, 4, 4])
    times = np.concatenate([[0.0], np.cumsum(np.where(lengths < 0.1, 0.2, 1.5))])
    return {"keys": walk(random_steps(rng, lengths)), "times": times}


def nearly_identical() -> Content:
    """Eight orientations a ten-thousandth of a degree apart."""
    rng = np.random.default_rng(3)
    return {"keys": walk(random_steps(rng, np.full(7, np.radians(1e-4)))), "times": np.arange(8.0)}


def half_turns() -> Content:
    """Six orientations, each half a turn but one degree from the one before."""
    rng = np.random.default_rng(4)
    return {"keys": walk(random_steps(rng, np.full(5, np.radians(179.0)))), "times": np.arange(6.0)}


def spin() -> Content:
    """Two turns about one tilted axis at a constant rate, a keyframe every 120 degrees."""
    axis = np.array([1.0, 2.0, 2.0]) / 3.0
    return {"keys": walk([axis * np.radians(120.0)] * 6), "times": 0.8 * np.arange(7.0)}


def whole_turns() -> Content:
    """Five orientations with one, two and minus one whole turns on the way."""
    rng = np.random.default_rng(6)
    return {
        "keys": walk(random_steps(rng, np.radians([60.0, 40.0, 80.0, 50.0]))),
        "times": np.array([0.0, 3.0, 4.0, 9.0, 12.0]),
        "turns": [0, 1, 0, 2, -1],
    }


def hand_held() -> Content:
    """A camera held by hand, 40 samples at 10 Hz: a slow pan with a tremor of half a degree."""
    rng = np.random.default_rng(7)
    times = 0.1 * np.arange(40.0)
    pan = np.stack([0.3 * times, 0.15 * np.sin(1.1 * times), 0.05 * np.cos(0.7 * times)], axis=-1)
    tremor = exp(np.radians(0.5) * rng.normal(size=(40, 3)))
    return {"keys": multiply(from_euler("ZYX", pan), tremor), "times": times}


def ideal_samples() -> Content:
    """Eight samples of an ideal orientation function, by chord length (Nielson, Figs. 10, 11)."""
    return {"keys": samples_of_ideal()}


def fly_through() -> Content:
    """A camera through a building, from rest to rest: eight views with their places."""
    degrees = [
        [0, 0, 0],
        [20, 5, 0],
        [65, 8, -4],
        [100, -5, -10],
        [95, -20, 0],
        [150, -10, 8],
        [210, 0, 3],
        [230, 0, 0],
    ]
    places = [
        [0.0, 0.0, 1.7],
        [2.0, 0.2, 1.7],
        [3.6, 1.6, 1.8],
        [3.9, 4.0, 2.4],
        [3.5, 6.0, 3.4],
        [1.8, 7.0, 3.2],
        [-0.4, 6.4, 2.6],
        [-1.6, 5.2, 2.4],
    ]
    return {
        "keys": from_euler("ZYX", np.radians(degrees)),
        "times": np.array([0.0, 1.6, 3.2, 5.2, 6.8, 8.6, 10.6, 12.4]),
        "positions": places,
        "start_velocity": [0.0, 0.0, 0.0],
        "end_velocity": [0.0, 0.0, 0.0],
    }


def boomerang() -> Content:
    """A boomerang: two orientations with a fast spin at both (Kim, Kim and Shin, Fig. 7)."""
    task = boomerang_task()
    return {
        "keys": task.keys,
        "times": task.times,
        "start_velocity": task.omega_start,
        "end_velocity": task.omega_end,
    }


def rest_to_rest() -> Content:
    """One turn of 120 degrees about a tilted axis from rest to rest."""
    return {
        "keys": walk([np.radians(120.0) * np.array([2.0, -1.0, 2.0]) / 3.0]),
        "times": np.array([0.0, 2.0]),
        "start_velocity": [0.0, 0.0, 0.0],
        "end_velocity": [0.0, 0.0, 0.0],
    }


def uneven_times() -> Content:
    """Seven orientations 45 degrees apart at intervals from 0.05 to 5 s."""
    rng = np.random.default_rng(12)
    intervals = np.array([1.0, 0.2, 5.0, 0.05, 1.0, 3.0])
    return {
        "keys": walk(random_steps(rng, np.full(6, np.radians(45.0)))),
        "times": np.concatenate([[0.0], np.cumsum(intervals)]),
    }


def repeated_and_flipped() -> Content:
    """Eight orientations of which some stay for a second keyframe and some come as -q."""
    rng = np.random.default_rng(13)
    keys = walk(random_steps(rng, np.radians([50, 0, 50, 30, 0, 60, 40])))
    signs = np.array([1, -1, -1, 1, -1, 1, 1, -1])[:, None]
    return {"keys": keys * signs, "times": np.arange(8.0)}


def gimbal_lock() -> Content:
    """Yaw, pitch and roll that cross a pitch of 90 degrees, where Euler angles fail."""
    degrees = [[0, 60, 0], [20, 75, 10], [40, 89, 20], [60, 90, 30], [80, 95, 40], [100, 110, 60]]
    return {"keys": from_euler("ZYX", np.radians(degrees)), "times": 0.7 * np.arange(6.0)}


SEQUENCES: tuple[Callable[[], Content], ...] = (
    spread,
    clustered,
    nearly_identical,
    half_turns,
    spin,
    whole_turns,
    hand_held,
    ideal_samples,
    fly_through,
    boomerang,
    rest_to_rest,
    uneven_times,
    repeated_and_flipped,
    gimbal_lock,
)


def text_of(sequence: Callable[[], Content]) -> str:
    """Return the motion file of a sequence."""
    content = sequence()
    lines = [f"# {(sequence.__doc__ or '').strip()}", "keyframes:"]
    times = content.get("times")
    for index, q in enumerate(np.asarray(content["keys"])):
        parts = [] if times is None else [f"time: {_number(times[index])}"]
        named = ", ".join(f"{name}: {_number(part)}" for name, part in zip("wxyz", q, strict=True))
        parts.append(f"quaternion: {{{named}}}")
        if "positions" in content:
            parts.append(f"position: {_list(content['positions'][index])}")
        if content.get("turns") and content["turns"][index]:
            parts.append(f"turns: {content['turns'][index]}")
        lines.append(f"  - {{{', '.join(parts)}}}")
    lines += [
        f"{name}: {_list(content[name])}"
        for name in ("start_velocity", "end_velocity")
        if name in content
    ]
    return "\n".join(lines) + "\n"


def _number(value) -> str:
    # Fifteen digits are the same on every machine; the last two of a double may not be.
    text = f"{float(value) + 0.0:.15f}".rstrip("0")
    return text + "0" if text.endswith(".") else text


def _list(values) -> str:
    return f"[{', '.join(_number(value) for value in values)}]"


def main() -> None:
    """Write every motion file."""
    for sequence in SEQUENCES:
        (HERE / f"{sequence.__name__}.yaml").write_text(text_of(sequence), encoding="utf-8")


if __name__ == "__main__":
    main()
