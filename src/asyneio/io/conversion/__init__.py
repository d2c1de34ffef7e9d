"""Conversion of a recording to another format."""
