"""Seeded generators of requests of every kind, from which benches and tests draw.

The same seed yields the same requests, so a bench may take hundreds of those of which a test takes
ten.  Each module beside this one has the judge of its kind, which shares no code with the planner.
"""

from bench.following_requests import blends, chains
from bench.pointing_requests import pointings
from bench.single_requests import plans

__all__ = ["blends", "chains", "plans", "pointings"]
