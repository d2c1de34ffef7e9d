# SPDX-License-Identifier: Apache-2.0
"""Event text, one event per line."""
