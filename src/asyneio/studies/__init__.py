"""Repeatable studies: conditions times seeds, measured in parallel, reported as tables and figures."""
