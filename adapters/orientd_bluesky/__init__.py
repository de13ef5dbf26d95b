"""An axis of rotation for bluesky."""

from orientd_bluesky.axis import RotationAxis
from orientd_bluesky.values import FlyScan, MotionStatus
