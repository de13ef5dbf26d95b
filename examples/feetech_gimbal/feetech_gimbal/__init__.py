"""A gimbal on Feetech STS bus servos: an example of a driver for orientd."""
