"""HDF5 files: asyneio's own layout and those of public data sets."""
