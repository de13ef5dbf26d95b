"""Measurements on this machine: the servo beside a bare C loop, the curves beside scipy."""
