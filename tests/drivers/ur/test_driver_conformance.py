"""The UR driver keeps what every driver promises, against an emulated robot."""

import pytest

from orientd.driver import (
    Arriving,
    Diagnosable,
    Explaining,
    Freeable,
    Healthy,
    Locatable,
    PhaseLocked,
    Resettable,
    RestsInFault,
    Scaled,
    Tunable,
)
from orientd.mechanism import Mechanical
from orientd.testing import DriverConformance
from orientd_ur import UrDriver

pytest.importorskip("rtde_control")

pytestmark = pytest.mark.world


class TestUrDriver(DriverConformance):
    follow_tolerance = 1e-6
    settle_cycles = 700
    protocols = (
        Arriving,
        Diagnosable,
        Explaining,
        Freeable,
        Healthy,
        Locatable,
        Mechanical,
        PhaseLocked,
        Resettable,
        RestsInFault,
        Scaled,
        Tunable,
    )

    @pytest.fixture(autouse=True)
    def _robot(self, ur_robot):
        self.robot = ur_robot

    def make_driver(self):
        return UrDriver(
            # A busy machine lets nobody run for longer than a real controller ever pauses.
            {
                "host": self.robot.host,
                "lookahead": 0.03,
                "feedback_timeout": 1.0,
                "link_timeout": 2.0,
                "watchdog_hz": 1,
            },
            period_ns=2_000_000,
            clock=self.clock,
        )

    def break_device(self):
        self.robot.ask("freeze")
        return True
