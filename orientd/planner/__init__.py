"""Plan motions: from a request to an immutable :class:`Motion` with its certificate.

Start with :func:`plan`.  A request checks itself when it is made.  The :class:`Certificate` of a
motion has the properties that it guarantees.

Names load on first use: limits need none of the planning modules, and a daemon that has not planned
yet stays small.

Other packages import from ``blending``, ``certify.certificate``, ``certifying``,
``device_planner``, ``facts``, ``methods``, ``motion``, ``offline``, ``path``, ``planning``,
``recorded``, ``resolve``, ``state`` and ``task``.
"""

from orientd.lazy import lazily

TYPE_CHECKING = False  # of typing, without loading it
if TYPE_CHECKING:
    from orientd.driver import Quaternion, Vector3
    from orientd.model.limits import ANGULAR, AXES, DEFAULT_LIMITS, NO_AXES, UNITS, Limits, Rate
    from orientd.model.request import (
        DEFAULT_METHOD,
        Frame,
        Keyframe,
        MotionRequest,
        Pose,
        named_frames,
    )
    from orientd.planner.blending import NOT_BLENDED, blend
    from orientd.planner.certify.certificate import Certificate, Peak
    from orientd.planner.certifying import reshaped
    from orientd.planner.device_planner import DevicePlanner
    from orientd.planner.facts import HISTORY, MOTION_RECORD, MotionFacts
    from orientd.planner.methods import check_method, curve_of
    from orientd.planner.motion import Motion
    from orientd.planner.offline import in_parallel, need_backend, plan_many
    from orientd.planner.path import PathSamples, position_path
    from orientd.planner.planning import plan
    from orientd.planner.recorded import RecordedMotion, rows_of, start_of, states_between
    from orientd.planner.resolve import in_device_coordinates, report_frame
    from orientd.planner.state import State
    from orientd.planner.task import distinct, plan_as_recorded, replay_request, task_of

__getattr__ = lazily(__name__)
