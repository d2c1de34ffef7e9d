"""Bags of ROS 1 and ROS 2.

Bags are read by our own code and written by the library `rosbags`: reading keeps what stands before a
cut or a damaged chunk, decodes only the fields that are needed, and takes event messages about a
hundred times as fast (benchmarks/readers.py).
"""
