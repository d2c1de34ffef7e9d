"""Event-driven front end: from events to asynchronous feature trajectories (Algorithm 1 of the paper)."""
