"""Folders of feature tracks and inertial samples."""
