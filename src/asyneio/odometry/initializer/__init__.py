"""The first window: from a known state, stationary, or in motion; and what speaks against accepting it."""
