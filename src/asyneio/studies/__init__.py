"""Comparisons as repeatable studies: conditions times seeds, measured in parallel, told in tables."""
