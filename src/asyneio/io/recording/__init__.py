"""Recordings of any format: contents, sidecar files, checks, cache, assembly."""
