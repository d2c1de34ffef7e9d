"""Phrases that the project does not use, and where they are looked for.

`python tests/docs/banned.py` prints the hits per page and per room; `--all` prints every hit.
"""

from __future__ import annotations

import ast
import io
import re
import sys
import tokenize
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[2]

#: Regular expression (word boundaries are added, case is ignored) and what to write instead.
BANNED: dict[str, str] = {
    # Inverted and compressed sentences.
    r"(read|refused|repaired|told|wanted) are": "subject first: 'Supported formats: ...'",
    r"who knows": "'if ... is known'",
    r"who only reads": "'without feedback'",
    r"what (it|this|that) is,? is": "'the format is detected from the contents'",
    r"so many(-th)?": "a number, or 'every n-th'",
    r"as many more": "say what grows and to what size",
    r"of (then|now)": "'current', or the date or commit",
    r"(one|row|file|record|figure|ns|ms|us|µs) an? (event|line|knot|call|window|field|feature|second|row)": (
        "per"
    ),
    r"in words(?! \()(?!\))|with a sentence|in a sentence": "'with a message'",
    r"as (it|they) (is|are|stands?|stand) in": "'unmodified'",
    r"bears? (this|it) out|are borne|is borne": "'confirms', 'tolerated'",
    r"as ever": "'as usual'",
    r"anew": "'again'",
    r"(goes|go|went|gone) on": "'continues'",
    r"(goes|go) (first|before)": "'takes precedence'",
    r"on the way": "'online', 'during the run'",
    r"amiss": "'wrong'",
    r"gives? away|give away": "'reveals'",
    r"no matter": "'contributes little'",
    r"not looked (into|up)|looked into": "'not investigated'",
    r"throw-?away": "name the command, or 'one-off script'",
    r"as remembered": "cite the source",
    r"for scale[,:;.)]": "'for reference'",
    r"became of it": "'the result'",
    r"how it is": "'its state'",
    r"of no use": "'not used'",
    r"whole calibration": "'complete calibration'",
    r"(is|are|was|were|not|all|runs?) whole": "'complete'",
    r"is no setting": "'unknown setting'",
    r"taken? back|takes? it back": "'reverted'",
    # People and speech.
    r"told|foretold|foretells?": "'reported', 'detected', 'predicted'",
    r"said": "'reported', 'stated'",
    r"(is|are|was|were) asked|asked for|asks (the|which|whether|those|for)": "'checked', 'requires'",
    r"nobody|somebody|anybody|whoever": "'no one', or say who",
    r"given out|gives? out|giving out": "'output', 'emitted', 'reported'",
    r"wants": "'requires', 'expects'",
    r"believed|disbelieved": "'assumed'",
    # Law, medicine, morals.
    r"blam(e|ed|es)": "'cause'",
    r"condemn(ed|s|ing)?": "'rejected'",
    r"accus(e|ed|es|ing)": "'rejected'",
    r"verdicts?": "'result'",
    r"witness(es)?": "'reference', 'check'",
    r"(?<!kind of )(?<!kinds of )evidence(?!:)": "'measurements', 'inspection'",
    r"cures?|cured": "'fix'",
    r"refus(e|es|ed|al|als|ing)": "'reject'",
    r"(tracks|samples|measurements|observations)( and samples)? that lie": "'outliers'",
    # One word for one thing.
    r"stillness|standstill": "'stationary'",
    r"at rest|a (short |long |first |longer )?rest|rests": "'stationary', 'stationary phase'",
    r"stands? still|standing still|stood still": "'stationary'",
    r"still-looking": "'stationary'",
    r"misfits?": "'chi-square test'",
    r"intake": "'measurement buffer'",
    r"vitals": "'health metrics'",
    r"upkeep": "'track management'",
    r"makes? up for|made up for|making up for": "'the budget is raised'",
    r"places for|feature's place|the places of": "'capacity', 'position'",
    r"founded|founding|to found": "'seed'",
    r"blows?": "'shock', 'spike'",
    r"loud(er|est)?": "'noisy'",
    r"doubtful": "'suspect'",
    r"beside (it|them|the recording|the events|any)": "'next to', 'sidecar file'",
    r"holds? no lens|lens, extrinsics": "'intrinsics'",
    r"specimens?": "'unit'",
    r"(?<!progress )(?<!error )(?<!status )(?<!colour )(?<!side)bars?(?!-Shalom)": "'target', 'threshold'",
    r"sharpest (picture|patch)": "'highest contrast'",
    r"is true of": "'is modelled'",
    r"spoils?|spoiled": "'degrades', 'corrupts'",
}

_PATTERN = re.compile(rf"\b(?:{'|'.join(f'(?:{phrase})' for phrase in BANNED)})(?!\w)", re.IGNORECASE)


class Hit(NamedTuple):
    """A banned phrase: the file, the line (from 1) and the words."""

    path: Path
    line: int
    words: str


def find(text: str) -> Iterator[tuple[int, str]]:
    """Line (from 1) and words of every banned phrase; a phrase may run over the end of a line."""
    flat = re.sub(r"\n", " ", text)
    for match in _PATTERN.finditer(re.sub(r" (?= *[#|>] )", " ", flat)):
        yield text.count("\n", 0, match.start()) + 1, match.group()


def prose_of_page(text: str) -> str:
    """A page without code: fenced blocks, indented commands, inline code and addresses are blanked."""

    def blank(match: re.Match[str]) -> str:
        return re.sub(r"[^\n]", " ", match.group())

    for pattern in (r"^```.*?^```$", r"^ {4,}(?:asyneio|make|python|pip)\b.*$", r"`[^`\n]+`", r"\]\([^)]*\)"):
        text = re.sub(
            pattern, blank, text, flags=re.MULTILINE | re.DOTALL if "```" in pattern else re.MULTILINE
        )
    return text


def texts_of_source(source: str) -> Iterator[tuple[int, str]]:
    """First line and text of every comment block and string literal, docstrings included."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and " " in node.value:
            yield node.lineno, re.sub(r"`[^`\n]+`", lambda m: " " * len(m.group()), node.value)
    block: list[str] = []
    first = last = 0
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type != tokenize.COMMENT:
            continue
        if block and token.start[0] != last + 1:
            yield first, "\n".join(block)
            block = []
        if not block:
            first = token.start[0]
        last = token.start[0]
        block.append(re.sub(r"`[^`\n]+`", lambda m: " " * len(m.group()), token.string.lstrip("#: ")))
    if block:
        yield first, "\n".join(block)


def pages() -> list[Path]:
    """The README, the changelog, the contributor's page and every page of the documentation."""
    return [ROOT / name for name in ("README.md", "CHANGELOG.md", "CONTRIBUTING.md")] + sorted(
        (ROOT / "docs").rglob("*.md")
    )


def hits_in_page(path: Path) -> list[Hit]:
    """Banned phrases of a page."""
    return [Hit(path, line, words) for line, words in find(prose_of_page(path.read_text()))]


def hits_in_source(path: Path) -> list[Hit]:
    """Banned phrases in docstrings, comments and string literals of a module."""
    return [
        Hit(path, first + line - 1, words)
        for first, text in texts_of_source(path.read_text())
        for line, words in find(text)
    ]


def rooms() -> dict[str, list[Path]]:
    """Python files by room: packages of src/asyneio, its top modules, benchmarks and examples."""
    package = ROOT / "src" / "asyneio"
    found = {
        folder.name: sorted(folder.rglob("*.py"))
        for folder in sorted(package.iterdir())
        if folder.is_dir() and folder.name != "__pycache__"
    }
    found["top modules"] = sorted(package.glob("*.py"))
    for name in ("benchmarks", "examples"):
        found[name] = sorted((ROOT / name).rglob("*.py"))
    return found


def main() -> None:
    """Print the hits."""
    hits = {str(path.relative_to(ROOT)): hits_in_page(path) for path in pages()}
    hits |= {room: [h for path in files for h in hits_in_source(path)] for room, files in rooms().items()}
    for name, found in hits.items():
        if found:
            common = Counter(hit.words.lower() for hit in found).most_common(6)
            print(f"{len(found):5d}  {name:32s} {', '.join(f'{words} {n}' for words, n in common)}")
        if "--all" in sys.argv:
            for hit in found:
                print(f"       {hit.path.relative_to(ROOT)}:{hit.line}: {hit.words}")


if __name__ == "__main__":
    main()
