"""Continuous-time trajectory: a motion prior on local variables around the last knot (7)-(20)."""
