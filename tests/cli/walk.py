"""Every command of the command line, and parsing without running."""

from __future__ import annotations

import shlex
from collections.abc import Iterator
from typing import Any

import typer
from typer.main import get_command

from asyneio.cli.main import app

#: Typer may bring a copy of click of its own: both are reached by what Typer exports.
UsageError = typer.BadParameter.__mro__[1]


def commands(command: Any = None, name: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], Any]]:
    """Every command and group, by the words that call it."""
    command = command or get_command(app)
    yield name, command
    for word, below in getattr(command, "commands", {}).items():
        yield from commands(below, (*name, word))


COMMANDS = dict(commands())


def find(words: list[str]) -> tuple[Any, list[str]]:
    """The command named by the first words, and the remaining words. Raises UsageError: there is none."""
    command, rest = COMMANDS[()], list(words)
    while getattr(command, "commands", None) and rest and not rest[0].startswith("-"):
        if rest[0] not in command.commands:
            raise UsageError(f"no command {rest[0]}")
        command = command.commands[rest.pop(0)]
    return command, rest


def parse(line: str) -> None:
    """Parse a command line without running it. Raises UsageError."""
    program, *arguments = shlex.split(line)
    assert program == "asyneio"
    command, rest = find(arguments)
    command.make_context("asyneio", rest)
