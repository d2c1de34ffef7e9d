"""HDF5 files: our own layout and those of public data sets."""
