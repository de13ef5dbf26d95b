"""Who commands which device, for how long, and what becomes of their motions when that changes."""
