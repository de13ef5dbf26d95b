"""The messages of the control socket, and what turns them into values and back.

Other packages import from ``columns``, ``cones``, ``limits``, ``reports``, ``status``, ``stub``,
``targets`` and ``values``.
"""

from orientd.protocol.reports import CellReport, Samples, plain
from orientd.protocol.stub import control_stub
from orientd.protocol.values import quaternion, to_quaternion, to_vector, vector
