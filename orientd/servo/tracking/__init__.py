"""Follow targets that arrive at any time, within the limits of every cycle.

A time-optimal generator per axis, such as ruckig, has the wrong limits: boxes, instead of norms of
a rotation's derivatives in the body's own frame.  A box inside the ball gives away up to 42 % of
each limit, and a box around it breaks the limit on the diagonal.  Derivatives of rotation vectors
in a fixed chart are not the body's angular velocity, so limits kept in the chart are not kept by
the body. Its jerk also jumps within a cycle, so the backward differences of the final approach are
not determined.

Here the state *is* the chain of backward differences that the guard checks.  A limit is kept
because no other state is ever chosen (:mod:`orientd.servo.tracking.law`).  The tests compare with
ruckig, whose duration about one axis is the optimum.

Other packages import from ``chunk_report``, ``chunks``, ``law``, ``preview``, ``quintic``,
``reference``, ``target_follower`` and ``tracker``.
"""
