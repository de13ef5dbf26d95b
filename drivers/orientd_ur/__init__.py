"""The UR driver: Universal Robots arms over the client library ``ur-rtde``."""

from __future__ import annotations

from orientd_ur.driver import UrDriver
