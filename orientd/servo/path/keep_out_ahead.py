"""Look along the path for keep-out cones, as far as a stop on it may lead.

The planner has certified the path.  But the clock may have been set since, and a cone has moved
with it.  If the path then leads into a cone, the device stops on the path, outside.
"""

from __future__ import annotations

from orientd.servo.keep_out_cones import MOST_DRIFT, SLACK, KeepOutCones
from orientd.servo.path.path_follower import PathFollower

MOST_RECORDS = 16
"""Records that are looked at in one cycle."""


class KeepOutAhead:
    """The records ahead that are known to be outside of every cone.

    Args:
        cones: the cones.
        follower: position on the path.
        period: cycle period, s.
    """

    def __init__(self, cones: KeepOutCones, follower: PathFollower, period: float) -> None:
        self._cones, self._follower, self._period = cones, follower, period
        self._clear, self._revision, self._turned = 0, -1, 0.0

    def intrusion(self, records: int) -> str:
        """Return into which cone the next records lead; empty if into none.

        Call it once a cycle while the path is followed.

        Args:
            records: number of records that a stop from here may use.
        """
        cones, follower = self._cones, self._follower
        self._clear -= 1
        if follower.revision != self._revision or cones.turned - self._turned > SLACK:
            self._clear, self._revision, self._turned = 0, follower.revision, cones.turned
        # Until the device is there, the cones turn on.
        drift = records * self._period * cones.rate
        step = self._period * (follower.fastest + MOST_DRIFT)
        for _ in range(MOST_RECORDS):
            if self._clear > records:
                break
            self._clear = max(self._clear, 0)
            point = follower.record_ahead(self._clear)
            if point is None:
                break
            least = min(cones.clearances(point.q)) - drift
            if least < -SLACK:
                before = follower.record_ahead(max(self._clear - 1, 0)) or point
                problem = cones.intrusion(before.q, point.q, slack=SLACK - drift)
                if problem:
                    return problem
            # The records between are nearer by at most this way.
            self._clear += max(1, int(least / step))
        return ""
