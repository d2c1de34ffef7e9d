"""One recording written in another format."""
