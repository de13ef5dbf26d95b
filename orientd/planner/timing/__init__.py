"""How quickly to run along a path: times for keyframes, the fastest profile inside the limits."""
