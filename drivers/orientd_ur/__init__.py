"""The UR driver: Universal Robots arms over the client library ``ur-rtde``."""

from orientd_ur.driver import UrDriver

__all__ = ["UrDriver"]
