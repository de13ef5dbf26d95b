"""Reproduce the figures of the papers, with bodies drawn along a motion."""
