# SPDX-License-Identifier: Apache-2.0
"""Bags of ROS 1 and ROS 2.

Bags are read by asyneio's own code and written with the library `rosbags`. The own reader recovers everything
before a truncation or a damaged chunk, decodes only the required fields, and reads event messages about a
hundred times as fast (benchmarks/readers.py).
"""
