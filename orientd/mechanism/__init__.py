"""Mechanisms: the kinematics of a device's axes, and paths that keep the limits of the axes.

The servo uses plain floats and kernels.  Only the modules that plan whole paths need NumPy.

Other packages import from ``arrays``, ``chain``, ``figure``, ``following``, ``gimbal``,
``joint_path``, ``keep_out_slews``, ``mechanism``, ``pointing``, ``poles``, ``router``, ``routing``,
``timed_route``, ``turning``, ``unwinding`` and ``way``.
"""

from orientd.mechanism.gimbal import Gimbal
from orientd.mechanism.mechanism import Mechanical, Mechanism, Reserve
