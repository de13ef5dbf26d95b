"""Follow targets that arrive at any moment, inside the limits of every cycle.

Why not one time-optimal generator per axis, such as ruckig: its limits are boxes, ours are norms of
a rotation's derivatives in the body's own frame.  A box inside the ball gives away up to 42 % of
each limit, a box around it breaks the limit on the diagonal; rotation vectors of a fixed chart are
not the body's angular velocity, so that limits kept in the chart are not kept by the body; and its
jumps of jerk within a cycle leave open what backward differences make of the last stretch.  Here
the state *is* the chain of backward differences that the guard checks, a limit is kept because no
other state is ever chosen (:mod:`orientd.servo.motion_law`), and ruckig is the peer in the tests:
about one axis its duration is the least there is.
"""

from orientd.servo.tracking.target_follower import TargetFollower
from orientd.servo.tracking.targets import Target
from orientd.servo.tracking.tracker import Tracker, TrackPoint
