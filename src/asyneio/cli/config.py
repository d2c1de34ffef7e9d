# SPDX-License-Identifier: Apache-2.0
"""`asyneio config`: show settings with their meaning, and compare them."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from asyneio.cli.options import PresetOption, settings_of

if TYPE_CHECKING:
    from asyneio.config import Config

config = typer.Typer(help="Show settings, or compare two sets of settings.", no_args_is_help=True)

_SOURCE_HELP = "YAML file of settings, results folder, or preset."
_WIDTH = 100


@config.command(epilog="Example: asyneio config show --preset DAVIS240C")
def show(
    file: Annotated[Path | None, typer.Argument(help="YAML file of settings, or results folder.")] = None,
    preset: PresetOption = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON, without explanations.")] = False,
) -> None:
    """Print all resolved settings with their meaning.

    Save the output, edit it, and pass it with --config.
    """
    import json

    settings = settings_of(_settings_file(file) if file else None, preset)
    typer.echo(json.dumps(settings.model_dump(), indent=2) if as_json else annotated(settings).rstrip())


@config.command(epilog="Example: asyneio config diff results/desk")
def diff(
    first: Annotated[str, typer.Argument(help=_SOURCE_HELP)],
    second: Annotated[str | None, typer.Argument(help=_SOURCE_HELP, show_default="the defaults")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON instead of a table.")] = False,
) -> None:
    """Print the settings that differ between two sets, or from the defaults."""
    import json

    from asyneio.cli import console
    from asyneio.config import Config, differences

    name = second or "default"
    found = differences(_named(first), _named(second) if second else Config())
    if as_json:
        typer.echo(json.dumps({key: {first: a, name: b} for key, (a, b) in found.items()}, indent=2))
    elif not found:
        console.say(f"{first} and {name} are equal")
    else:
        rows = [(key, f"{_text(a)}  ({name}: {_text(b)})") for key, (a, b) in found.items()]
        console.table(first, rows)


def annotated(settings: Config) -> str:
    """All settings as YAML, each below its meaning; with the default if the value differs from it."""
    import textwrap

    from asyneio.config import Config

    lines: list[str] = []
    defaults = Config()
    for name, section in settings:
        first_line = (type(section).__doc__ or "").strip().split("\n")[0]
        lines += [f"# {first_line}", f"{name}:"]
        for key, field in type(section).model_fields.items():
            value, default = getattr(section, key), getattr(getattr(defaults, name), key)
            changed = f" [default: {_text(default)}]" if value != default else ""
            text = f"{field.description or ''}{changed}".strip()
            if text:
                lines.append(textwrap.fill(text, _WIDTH, initial_indent="  # ", subsequent_indent="  # "))
            lines.append(f"  {key}: {_text(value)}")
        lines.append("")
    return "\n".join(lines)


def _named(source: str) -> Config:
    """The settings of a file, of a results folder, or of a preset."""
    from asyneio.cameras import PRESETS
    from asyneio.errors import ConfigError

    if Path(source).exists():
        return settings_of(_settings_file(Path(source)), None)
    if source.lower() in {name.lower() for name in PRESETS}:
        return settings_of(None, source)
    raise ConfigError(f"{source} is neither a file nor a folder nor a preset; presets: {', '.join(PRESETS)}")


def _settings_file(path: Path) -> Path:
    from asyneio.pipeline import CONFIG_FILE

    return path / CONFIG_FILE if path.is_dir() else path


def _text(value: Any) -> str:
    """A value as YAML on one line."""
    import yaml

    text: str = yaml.safe_dump(value, default_flow_style=True, width=10**6)
    return text.removesuffix("\n").removesuffix("\n...")
