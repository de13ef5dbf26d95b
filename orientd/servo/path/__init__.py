"""Follow the path and stop on it: time scaling, stop rollout, feasible rates."""
