# SPDX-License-Identifier: Apache-2.0
"""Recordings of any format: contents, sidecar files, checks, cache, assembly."""
