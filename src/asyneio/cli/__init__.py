# SPDX-License-Identifier: Apache-2.0
"""The command line: parses options, calls the library, prints."""
