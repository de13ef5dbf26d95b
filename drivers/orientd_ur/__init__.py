"""The UR driver: Universal Robots arms over the client library ``ur-rtde``."""

from __future__ import annotations

from typing import TYPE_CHECKING

from orientd.lazy import lazily

if TYPE_CHECKING:
    from orientd_ur.driver import UrDriver

__getattr__ = lazily(__name__)
