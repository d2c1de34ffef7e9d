# SPDX-License-Identifier: Apache-2.0
"""Event-level simulator: textured worlds rendered through a lens, pixels that answer with events."""
