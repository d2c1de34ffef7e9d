"""`python -m asyneio`: the command, also where its script is not on the path."""

from asyneio.cli.main import main

if __name__ == "__main__":
    main()
