"""Fit a curve to orientations that were measured."""
