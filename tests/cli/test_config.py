"""`asyneio config`: the output is valid input, differences are complete, errors are explained."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from asyneio import cameras as presets
from asyneio.cameras import PRESETS, Preset
from asyneio.config import Config, load_config
from tests.cli.conftest import Asyneio


def test_the_output_of_show_is_valid_input(asyneio: Asyneio, tmp_path: Path) -> None:
    changed = tmp_path / "changed.yaml"
    changed.write_text("window: {knot_interval_s: 0.05}\nfrontend: {tracker: haste}\n")
    status, out, _ = asyneio("config", "show", changed)
    assert status == 0
    again = tmp_path / "again.yaml"
    again.write_text(out)
    assert load_config(again) == load_config(changed) != Config()
    assert "# time between knots [default: 0.1]\n  knot_interval_s: 0.05" in out
    assert "# Sliding window." in out
    # Every setting has a description, except the few with self-explanatory names.
    unexplained = out.count("\n  ") - 2 * out.count("\n  #")
    assert unexplained <= 3


def test_show_as_json(asyneio: Asyneio) -> None:
    status, out, _ = asyneio("config", "show", "--json")
    assert status == 0
    assert json.loads(out) == Config().model_dump()


def test_show_a_preset(asyneio: Asyneio, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    preset = Preset("Slow", "a slow camera", (8, 8), settings={"frontend": {"max_features": 50}})
    monkeypatch.setitem(presets.PRESETS, "Slow", preset)
    status, out, _ = asyneio("config", "show", "--preset", "slow")
    assert status == 0
    assert "max_features: 50" in out
    above = tmp_path / "above.yaml"
    above.write_text("frontend: {max_features: 60, spacing: 0.05}\n")
    found = json.loads(asyneio("config", "show", above, "--preset", "slow", "--json")[1])
    assert (found["frontend"]["max_features"], found["frontend"]["spacing"]) == (60, 0.05)


@pytest.mark.parametrize("name", PRESETS)
def test_settings_of_every_preset_are_valid(name: str) -> None:
    load_config(None, PRESETS[name].settings)


def test_diff(asyneio: Asyneio, tmp_path: Path) -> None:
    results = tmp_path / "results"
    results.mkdir()
    (results / "config.yaml").write_text("health: {max_speed: 12.0}\n")
    other = tmp_path / "other.yaml"
    other.write_text("health: {max_speed: 13.0}\nvisual: {pixel_sigma: 1.0}\n")
    status, out, _ = asyneio("config", "diff", results)
    assert status == 0
    assert "health.max_speed" in out
    assert "12.0  (default: 30.0)" in out
    found = json.loads(asyneio("config", "diff", results, other, "--json")[1])
    assert found == {
        "visual.pixel_sigma": {str(results): 0.5, str(other): 1.0},
        "health.max_speed": {str(results): 12.0, str(other): 13.0},
    }
    status, _, err = asyneio("config", "diff", "davis240c")
    assert status == 0
    assert "davis240c and default are equal" in err


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("windw: {length_s: 1.0}", "unknown setting windw; did you mean window?"),
        ("window: {lenght_s: 1.0}", "unknown setting window.lenght_s; did you mean length_s?"),
        (
            "window: {max_features: 10}",
            "unknown setting window.max_features; did you mean frontend.max_features?",
        ),
        ("max_features: 10", "unknown setting max_features; did you mean frontend.max_features?"),
        ("window: {zzz: 1}", "unknown setting window.zzz; expected one of knot_interval_s, length_s"),
        ("window: {length_s: -1}", "window.length_s: Input should be greater than 0"),
        ("window: 3", "window: Input should be a valid dictionary"),
        ("- 1", "contains a list; expected a mapping of sections"),
        ("a: [", "is not valid YAML"),
        ("a: !!int ''", "is not valid YAML"),
    ],
)
def test_mistakes_are_explained(asyneio: Asyneio, tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "settings.yaml"
    path.write_text(text)
    status, _, err = asyneio("config", "show", path)
    assert status == 1
    assert message in err
    assert err.count("\n") == 1


def test_sources_that_are_none(asyneio: Asyneio, tmp_path: Path) -> None:
    status, _, err = asyneio("config", "diff", "DAVIS128")
    assert status == 1
    assert "DAVIS128 is neither a file nor a folder nor a preset; presets: DAVIS240C" in err
    status, _, err = asyneio("config", "show", tmp_path)
    assert status == 1
    assert "cannot read the configuration" in err
    status, _, err = asyneio("config", "show", "--preset", "x")
    assert status == 1
    assert "preset 'x' is unknown; expected one of DAVIS240C" in err
