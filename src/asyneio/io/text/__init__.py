"""Event text, one event per line."""
