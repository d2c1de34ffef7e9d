# SPDX-License-Identifier: Apache-2.0
"""How lines of numbers are written: separators, decimal commas, headers, columns of text."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

from asyneio.io.parsing.column_names import Column, parse_column

_DECIMAL_COMMA = re.compile(r"[+-]?\d+,\d+([eE][+-]?\d+)?")


@dataclass(frozen=True)
class Dialect:
    """How lines are split into fields: at commas or semicolons only (`mark`), or at blanks as well."""

    mark: str
    decimal_comma: bool

    def split(self, text: str) -> list[str]:
        """Fields of a line, without blanks and quotes around them."""
        if self.mark:
            fields = text.split(self.mark)
            fields = fields[:-1] if not fields[-1].strip() else fields
            fields = [field.strip().strip('"') for field in fields]
        else:
            blank = text if self.decimal_comma else text.replace(",", " ")
            fields = blank.replace(";", " ").split() or [""]
        return [field.replace(",", ".") for field in fields] if self.decimal_comma else fields


def dialect_of(texts: list[str]) -> Dialect:
    """How these lines are written."""
    words = [word for text in texts for word in text.replace(";", " ").split()]
    commas = sum(_DECIMAL_COMMA.fullmatch(word) is not None for word in words)
    decimal_comma = commas > 0.5 * len(words) and not any("." in word for word in words)
    for mark in (";",) if decimal_comma else (",", ";"):
        fields = [[field.strip() for field in text.split(mark)] for text in texts]
        if all(len(row) > 1 and not any(map(_several_numbers, row)) for row in fields):
            return Dialect(mark, decimal_comma)
    return Dialect("", decimal_comma)


def _several_numbers(field: str) -> bool:
    """True if blanks separate numbers within a field; a name may contain blanks."""
    parts = field.split()
    return len(parts) > 1 and all(map(is_number, parts))


def header_columns(text: str, count: int, dialect: Dialect) -> tuple[Column, ...]:
    """The columns of a header; empty if it does not name `count`."""
    names = header_names(text, dialect)
    return tuple(map(parse_column, names)) if len(names) == count else ()


def header_names(text: str, dialect: Dialect) -> list[str]:
    """Column names of a header line, each with its unit if it has one."""
    text = text.lstrip("#% ").rstrip(",; ")
    mark = dialect.mark if dialect.mark and dialect.mark in text else "," if "," in text else ""
    if mark:
        return text.split(mark)
    # A unit in brackets belongs to the name before it, and may contain blanks.
    joined = re.sub(r"[\[(][^\])]*[\])]", lambda unit: unit.group().replace(" ", ""), text)
    return re.sub(r"\s+(?=[\[(])", "", joined).split()


def holds_numbers(text: str) -> bool:
    """True if most fields of a line are numbers."""
    fields = text.split("#", 1)[0].replace(";", " ").replace(",", " ").split()
    return 2 * sum(map(is_number, fields)) > len(fields)


def is_comment(text: str) -> bool:
    """True if a line is a comment."""
    return text.startswith(("#", "%"))


def is_number(token: str) -> bool:
    """True if a field is a number in any notation that is read."""
    return numbers_of([token], frozenset()) is not None


def numbers_of(tokens: list[str], texts: frozenset[int]) -> list[float] | None:
    """The fields as numbers, NaN in text columns; None if another field is not a number."""
    try:
        if texts:
            row = [math.nan if index in texts else float(token) for index, token in enumerate(tokens)]
        else:
            row = [float(token) for token in tokens]
    except ValueError:
        return None
    # Python accepts 1_000 as a number.
    return None if any("_" in token for k, token in enumerate(tokens) if k not in texts) else row
