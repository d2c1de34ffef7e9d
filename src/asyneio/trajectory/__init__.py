"""Continuous-time trajectory: white noise on jerk in the tangent space of the last knot (7)-(20)."""
