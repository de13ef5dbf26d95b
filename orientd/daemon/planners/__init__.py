"""Planner processes: warm, few, and each of them may be killed.

The daemon mostly waits and a planner calculates, so under one interpreter's lock each would delay
the other.  A :class:`PlanRequest` holds everything that a plan depends on.  Any process that plans
it again gets the same motion to the last bit.  No process keeps state that a plan needs.

Other packages import from ``messages``, ``planned_motion`` and ``pool``.
"""
