"""Astronomy programs: the device as an ASCOM Alpaca telescope and rotator."""
