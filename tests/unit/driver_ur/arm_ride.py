"""A motion of an arm in the real servo, with the joints that its poses ask for."""

import numpy as np
from arm_rig import joints_of
from joint_ride import JointRide
from rig import RecordingLoopback


class ArmRide(JointRide):
    """An arm whose driver takes poses: the joints that follow them are looked at."""

    def __init__(self, motion, arm):
        def driver(**settings):
            made = RecordingLoopback({}, **settings)
            made.mechanism = lambda *, may_ask: arm
            return made

        self.arm, self.axes = arm, arm.axes
        super().__init__(motion, driver)

    def sent_joints(self, before):
        rows = [tuple(row) for row in before.tolist()]
        poses = [(setpoint.q, setpoint.position) for setpoint in self.driver.setpoints]
        return np.vstack([rows, joints_of(self.arm, poses, rows[-1])])
