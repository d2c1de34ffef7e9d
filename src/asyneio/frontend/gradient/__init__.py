# SPDX-License-Identifier: Apache-2.0
"""The tracker of the paper (Algorithm 1): features located by the gradient of their active events."""
