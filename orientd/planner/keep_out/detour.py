"""A request with further keyframes that lead it around keep-out cones."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from orientd.model.request import Keyframe, MotionRequest
from orientd.planner.motion import Motion
from orientd.planner.state import State
from orientd.rotation import Floats, angle

_INDEX = re.compile(r"keyframes\[(\d+)\]")

_SHARES = 101  # points of a rate along a leg

Place = tuple[int, int]
"""A leg, and the index of an added keyframe in it."""


@dataclass(frozen=True, slots=True, eq=False)
class Detour:
    """A request with further keyframes.

    A leg leads to a keyframe of the request: leg 0 from the state of the device to the first one,
    if that needs a lead-in.

    Attributes:
        request: the request, with every orientation known.
        start: the commanded state of the device.
        added: orientations in each leg, each of shape ``(4,)``.
    """

    request: MotionRequest
    start: State
    added: tuple[tuple[Floats, ...], ...]

    @classmethod
    def of(cls, request: MotionRequest, start: State) -> Detour:
        """Return the request itself."""
        return cls(request, start, ((),) * len(request.keyframes))

    def with_added(self, leg: int, keys: Sequence[Floats]) -> Detour:
        """Return the detour with other keyframes added in one leg."""
        added = list(self.added)
        added[leg] = tuple(keys)
        return replace(self, added=tuple(added))

    def ending(self, q: Floats) -> Detour:
        """Return the detour with another orientation of the last keyframe."""
        w, x, y, z = q.tolist()
        *others, last = self.request.keyframes
        request = replace(self.request, keyframes=[*others, replace(last, q=(w, x, y, z))])
        return replace(self, request=request)

    def ends(self, leg: int) -> tuple[Floats, Floats]:
        """Return the orientations at both ends of a leg."""
        before = self.request.keys[leg - 1] if leg else self.start.q
        return before, self.request.keys[leg]

    @property
    def places(self) -> list[Place | None]:
        """The place of each keyframe of :meth:`whole`; ``None`` if it is not an added one."""
        found: list[Place | None] = [None] if self.added[0] else []
        for leg, added in enumerate(self.added):
            found += [(leg, index) for index in range(len(added))]
            found.append(None)
        return found

    def slot(self, k: int) -> Place:
        """Return the place of a new keyframe before keyframe *k* of :meth:`whole`."""
        places = self.places[:k]
        leg = sum(one is None for one in places) - bool(self.added[0])
        leg = min(max(leg, 0), len(self.added) - 1)
        return leg, sum(one is not None and one[0] == leg for one in places)

    def whole(self) -> MotionRequest:
        """Return the request with all keyframes."""
        request = self.request
        if not any(self.added):
            return request
        keyframes: list[Keyframe] = []
        for leg, (keyframe, added) in enumerate(zip(request.keyframes, self.added, strict=True)):
            if added and not leg:
                x, y, z = self.start.position.tolist()
                place = None if request.positions is None else (x, y, z)
                keyframes.append(_keyframe(self.start.q, None, place))
            times = self._times(leg)
            keyframes += [_keyframe(q, time) for q, time in zip(added, times, strict=True)]
            keyframes.append(keyframe)
        is_led = request.approach and not self.added[0]
        return replace(request, keyframes=keyframes, approach=is_led)

    def _times(self, leg: int) -> list[float | None]:
        """Return times of the keyframes added in a leg, by their distances.

        The rate along the leg is zero at an end where the motion rests, else that of the mean.
        """
        times, added = self.request.times, self.added[leg]
        if times is None or not leg or not added:
            return [None] * len(added)
        first, last = self.ends(leg)
        keys = np.array([first, *added, last])
        far = np.concatenate([[0.0], np.cumsum(angle(keys[:-1], keys[1:]))])
        request = self.request
        first_rate = 0.0 if leg == 1 and request.start_velocity is None else 1.0
        last_rate = 0.0 if leg == len(times) - 1 and request.end_velocity is None else 1.0
        share = np.linspace(0.0, 1.0, _SHARES)
        passed = _passed(share, first_rate, last_rate)
        found = np.interp(far[1:-1] / far[-1], passed, share)
        begin, end = float(times[leg - 1]), float(times[leg])
        return [begin + (end - begin) * one for one in found.tolist()]

    def own_times(self, motion: Motion) -> Floats:
        """Return the path times of the request's keyframes in the motion of :meth:`whole`, s."""
        times = motion.keyframe_times
        if not any(self.added):
            return times
        found: Floats = times[-len(self.places) :][[one is None for one in self.places]]
        return found[1:] if self.added[0] else found

    def restored(self, motion: Motion) -> Motion:
        """Return the motion of :meth:`whole` as one of the request, with its keyframes only."""
        times = self.own_times(motion)
        begin, end = float(times[0]), float(times[-1])
        certificate = replace(
            motion.certificate,
            lead_in=begin,
            lead_out=motion.duration - end,
            notes=tuple(map(self.worded, motion.certificate.notes)),
        )
        return replace(
            motion, request=self.request, keyframe_times=times, start_time=begin, end_time=end,
            certificate=certificate,
        )  # fmt: skip

    def worded(self, text: str) -> str:
        """Return a text on the motion of :meth:`whole` with the indices of the request."""
        own = [k for k, one in enumerate(self.places) if one is None][bool(self.added[0]) :]

        def index(found: re.Match[str]) -> str:
            k = int(found[1])
            return f"keyframes[{own.index(k)}]" if k in own else "a keyframe added around a cone"

        return _INDEX.sub(index, text) if any(self.added) else text


def _passed(share: Floats, first_rate: float, last_rate: float) -> Floats:
    """Return the quintic from 0 to 1 with given rates and no acceleration at its ends."""
    rest = 1.0 - first_rate
    end = last_rate - first_rate
    a, b, c = 10.0 * rest - 4.0 * end, -15.0 * rest + 7.0 * end, 6.0 * rest - 3.0 * end
    return share * (first_rate + share**2 * (a + share * (b + share * c)))


def _keyframe(
    q: Floats, time: float | None = None, place: tuple[float, float, float] | None = None
) -> Keyframe:
    w, x, y, z = q.tolist()
    return Keyframe((w, x, y, z), time, place)
