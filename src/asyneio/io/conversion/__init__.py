# SPDX-License-Identifier: Apache-2.0
"""Conversion of a recording to another format."""
