"""What the robot for LeRobot uses of LeRobot 0.4, for machines without it.

`make lerobot` runs the same tests with LeRobot itself.
"""
