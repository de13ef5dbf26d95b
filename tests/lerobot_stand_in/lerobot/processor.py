"""Types of actions and observations."""

RobotAction = dict
RobotObservation = dict
