"""The Python client: connect to a daemon, and command and watch its devices.

Other packages import from ``channel``, ``clutch``, ``connection``, ``daemon_clock``,
``endless_turn``, ``motion_text``, ``move_handle``, ``observer``, ``playing``, ``pointing``,
``robot``, ``smoothing``, ``stop_call``, ``target_messages``, ``teaching``, ``tracking`` and
``trust``.
"""

from orientd.lazy import lazily

TYPE_CHECKING = False  # of typing, without loading it
if TYPE_CHECKING:
    from orientd.client.clutch import Clutch
    from orientd.client.motion_text import RequestFields
    from orientd.client.move_handle import MoveHandle
    from orientd.client.observer import Observer
    from orientd.client.playing import Playing, PlayTiming
    from orientd.client.pointing import BaseReport, Pointing
    from orientd.client.robot import Robot, connect
    from orientd.client.teaching import MeasuredPose, Teaching
    from orientd.client.tracking import Tracking, TrackTiming

__getattr__ = lazily(__name__)
