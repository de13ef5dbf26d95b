"""Read recordings of other programs as orientations over time, and replay them.

MCAP files with poses, ROS 2 bags, tables and trajectories in text.

For other programs: ``orientations``.
"""

from orientd.lazy import lazily

TYPE_CHECKING = False  # of typing, without loading it
if TYPE_CHECKING:
    from orientd_replay.orientations import Orientations, read_orientations

__getattr__ = lazily(__name__)
