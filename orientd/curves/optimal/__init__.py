"""Curves of least effort or acceleration, and the searches for them."""
