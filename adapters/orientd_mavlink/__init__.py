"""MAVLink programs: the device as a gimbal with a gimbal manager (gimbal protocol v2)."""
