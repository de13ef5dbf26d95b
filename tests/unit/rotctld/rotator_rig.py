"""A rotator in virtual time: the pointer of rotctld steers the real servo with a real mechanism.

What lies between the two is left out: the client's library, the daemon and the bus.
"""

from types import SimpleNamespace
from unittest import mock

import numpy as np
import rig

from emulated_dynamixel import ManualClock
from orientd.protocol import control_pb2 as pb
from orientd.rotation import rotate
from orientd.servo.tracking.chunks import publish_chunk
from orientd.stream.records import Command, Sample, ServoLimits, ServoState
from orientd_dynamixel import DynamixelDriver
from orientd_rotctld import pointer as pointer_module
from orientd_rotctld.pointer import Pointer
from orientd_rotctld.ranges import Ranges
from orientd_serving.pointing import Direction

PERIOD = 0.05
ACCELERATION_DEG = 60.0
LIMITS = ServoLimits(1.5, 8.0, 1500.0, 1.0, 10.0, 4.0)
TOLERANCE = np.radians(0.5)


def driver_of(turns, heights, speed):
    """Return the driver of a rotator; angles in degrees, *speed* in degrees a second."""
    axes = [
        {"id": k + 1, "name": name, "limits_deg": list(limits), "velocity_deg": speed,
         "acceleration_deg": ACCELERATION_DEG}
        for k, (name, limits) in enumerate((("azimuth", turns), ("elevation", heights)))
    ]  # fmt: skip
    options = {"port": "virtual", "order": "ZY", "mount": {"w": 0, "x": 1, "y": 0, "z": 0},
               "allow_slews": True, "turns_file": "", "axes": axes}  # fmt: skip
    return DynamixelDriver(options, period_ns=round(1e9 * PERIOD), clock=ManualClock(1))


class Rotator:
    """A rotator at rest, and the device as a pointer sees it."""

    def __init__(self, turns, heights, speed, joints_deg):
        joints = tuple(np.radians(joints_deg).tolist())
        gimbal = driver_of(turns, heights, speed).mechanism(may_ask=False)

        class Device(rig.RecordingLoopback):
            takes = "joints"
            axes = gimbal.axes

            def enable(self):
                q = gimbal.orientation(joints)
                self._q = q
                return super().enable()._replace(q=q, joints=joints)

            def mechanism(self, *, may_ask):
                return gimbal

        with mock.patch.object(rig, "PERIOD_NS", round(1e9 * PERIOD)):
            self.rig = rig.Rig(kind=Device, heartbeat_ns=10**10, feedback_ns=10**10)
        self.rig.ask(Command.ENABLE)
        self._motion = 1
        self.lock = None

    @property
    def now(self):
        return 1e-9 * self.rig.clock.now_ns()

    # What a pointer asks of the device

    def report(self):
        w, x, y, z = self.rig.cycle.q
        p, q, r = self.rig.cycle.omega_body
        cycle = pb.Cycle(q=pb.Quaternion(w=w, x=x, y=y, z=z), omega_body=pb.Vector3(x=p, y=q, z=r))
        return pb.DeviceReport(cycle=cycle, limits=pb.Limits(acceleration=LIMITS.acceleration))

    def rest(self):
        """Rest: the moves of this device do not turn it."""

    def track(self):
        return self

    def chunk(self, poses, *, rate, start):
        if self.rig.cycle.state is not ServoState.TRACKING:
            self._motion += 1
            self.rig.ask(Command.TRACK, motion=self._motion, servo_limits=LIMITS)
        samples = [
            Sample(round(1e9 * (start + k / rate)), (one.w, one.x, one.y, one.z))
            for k, one in enumerate(poses)
        ]
        publish_chunk(self.rig.memory.chunks, samples, LIMITS)

    def move(self, poses, **_):
        """Stay: the device begins where the first positions are."""
        return SimpleNamespace(is_done=True)

    # The run

    def errors(self, times, azimuth, elevation, *, tips):
        """Send a position a second, and return setpoints at the times between.

        Args:
            times: s, each a cycle after the one before, shape ``(n,)``.
            azimuth: degrees, shape ``(n,)``.
            elevation: degrees.
            tips: whether the device may tip over.

        Returns:
            Angles from the target, rad, shape ``(n,)``, and joints, degrees, shape ``(n, 2)``.
        """
        passes = SimpleNamespace(takes=lambda *_: False, leave=lambda: None)
        ranges = Ranges((-180.0, 540.0), (-90.0, 180.0 if tips else 90.0))
        pointer = Pointer(self, passes, ranges)
        every = round(1.0 / PERIOD)
        q, joints = [], []
        clock = SimpleNamespace(monotonic=lambda: self.now)
        with (
            mock.patch.object(pointer_module, "time", clock),
            mock.patch.object(rig, "PERIOD_NS", round(1e9 * PERIOD)),
        ):
            for k in range(len(times)):
                if k % every == 0:
                    wanted = Direction(round(azimuth[k] % 360.0, 2), round(elevation[k], 2))
                    pointer.go(wanted, 0.005)
                cycle = self.rig.run()
                q.append(cycle.q)
                joints.append(cycle.sent_joints)
        made = rotate(np.array(q), [1.0, 0.0, 0.0])
        a, e = np.radians(azimuth), np.radians(elevation)
        aim = np.stack([np.cos(e) * np.cos(a), -np.cos(e) * np.sin(a), np.sin(e)], -1)
        # A setpoint is for the end of its cycle.
        apart = np.linalg.norm(made[:-1] - aim[1:], axis=1)
        return 2.0 * np.arcsin(np.minimum(1.0, apart / 2.0)), np.degrees(joints)[:-1]
