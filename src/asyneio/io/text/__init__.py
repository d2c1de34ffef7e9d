"""Events as text, one event a line."""
