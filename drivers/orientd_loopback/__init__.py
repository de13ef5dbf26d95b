"""The loopback driver: a device that is not there."""
