"""Simulation of feature tracks, without events."""
