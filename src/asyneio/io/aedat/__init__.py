"""AEDAT 2 (jAER) and AEDAT 4 (DV)."""
