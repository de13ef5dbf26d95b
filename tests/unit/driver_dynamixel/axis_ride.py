"""A motion of a gimbal in the real servo, with the gimbal's driver on no bus."""

import functools

import numpy as np
from joint_ride import JointRide

from orientd.driver import Feedback
from orientd_dynamixel import DynamixelDriver


class SilentGimbal(DynamixelDriver):
    """The driver without a bus: what it would send to the servos is kept, in rad."""

    def open(self):
        self.sent = [(0.0,) * len(self.settings.axes)]

    def enable(self):
        return self.read()

    def read(self):
        angles = self.sent[-1]
        q = self.mechanism(may_ask=False).orientation(angles)
        return Feedback(self.clock.now_ns(), q, joints=angles)

    def write(self, setpoint):
        self.sent.append(setpoint.joints)

    def rest_in_fault(self):
        pass

    def disable(self):
        pass


class AxisRide(JointRide):
    """A gimbal, whose driver takes joints; *settings* are the driver's."""

    def __init__(self, motion, settings, servo_limits=None):
        super().__init__(motion, functools.partial(SilentGimbal, settings), servo_limits)
        self.axes = self.driver.settings.axes

    def forget_sent(self):
        self.driver.sent = [
            tuple(row) for row in self.joints[self.record - 1 : self.record + 1].tolist()
        ]

    def sent_joints(self, before):
        return np.array(self.driver.sent)
