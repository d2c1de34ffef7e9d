# SPDX-License-Identifier: Apache-2.0
"""`python -m asyneio`: the command line."""

from asyneio.cli.main import main

if __name__ == "__main__":
    main()
