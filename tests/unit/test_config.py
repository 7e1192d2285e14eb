import dataclasses
from typing import Literal

import pytest

from bokehnet.config import OLD_KEYS, build_config, dump_json, load_config, parse_settings, renamed, to_dict
from bokehnet.errors import ConfigError, ParameterError


@dataclasses.dataclass(frozen=True, kw_only=True)
class Inner:
    rate: float = 1e-3
    name: str | None = None


@dataclasses.dataclass(frozen=True, kw_only=True)
class Outer:
    steps: int
    sizes: tuple[int, ...] = ()
    span: tuple[float, float] = (0.0, 1.0)
    mode: Literal["fast", "slow"] = "fast"
    on: bool = False
    inner: Inner = dataclasses.field(default_factory=Inner)


def write(tmp_path, text):
    path = tmp_path / "run.toml"
    path.write_text(text)
    return path


def test_file_and_overrides_fill_nested_dataclasses(tmp_path):
    path = write(tmp_path, 'steps = 5\nsizes = [1, 2]\nspan = [1, 2.5]\n[inner]\nrate = 1\nname = "x"\n')
    config = load_config(path, Outer, {"steps": 7, "inner.rate": 0.5, "mode": "slow"})
    expected = Outer(steps=7, sizes=(1, 2), span=(1.0, 2.5), mode="slow", inner=Inner(rate=0.5, name="x"))
    assert config == expected
    assert isinstance(config.span[0], float)
    assert build_config(to_dict(config), Outer) == config
    assert dump_json(config).startswith('{\n  "steps": 7')


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("steps = 1\nstep = 2", "unknown key 'step'; valid keys: inner, mode, on, sizes, span, steps"),
        ("steps = 1\n[inner]\nlr = 2", "unknown key 'inner.lr'; valid keys: name, rate"),
        ("steps = 1.5", "steps: expected int, got 1.5"),
        ("steps = true", "steps: expected int, got True"),
        ("steps = 1\non = 1", "on: expected bool, got 1"),
        ("steps = 1\nsizes = [1, 'a']", r"sizes\[1\]: expected int, got 'a'"),
        ("steps = 1\nspan = [1]", r"span: expected tuple\[float, float\], got \[1\]"),
        ("steps = 1\nmode = 'warp'", r"mode: expected Literal\['fast', 'slow'\], got 'warp'"),
        ("steps = 1\ninner = 3", "inner: expected a table, got 3"),
        ("sizes = []", "missing key 'steps'"),
        ("steps = ", "expected TOML"),
    ],
)
def test_mistakes_name_the_file_the_key_and_what_was_expected(tmp_path, text, message):
    with pytest.raises(ConfigError, match=r"run\.toml: " + message):
        load_config(write(tmp_path, text), Outer)


def test_missing_file_and_impossible_override_are_config_errors(tmp_path):
    with pytest.raises(ConfigError, match=r"cannot read config .*none\.toml"):
        load_config(tmp_path / "none.toml", Outer)
    with pytest.raises(ConfigError, match="steps is not a table"):
        load_config(write(tmp_path, "steps = 1"), Outer, {"steps.x": 2})


@dataclasses.dataclass(frozen=True, kw_only=True)
class Network:
    network_max_radius: float = 10.0
    see_features: bool = False


@dataclasses.dataclass(frozen=True, kw_only=True)
class Run:
    model: Network = dataclasses.field(default_factory=Network)
    augmented: float = 0.5


def test_keys_of_earlier_versions_are_read(tmp_path):
    path = write(tmp_path, "spoilt = 0.25\n[model]\nunit = 8\nsee_hints = true\n")
    expected = Run(model=Network(network_max_radius=8.0, see_features=True), augmented=0.25)
    assert load_config(path, Run) == expected
    assert set(to_dict(expected)["model"]) <= set(OLD_KEYS.values())
    assert renamed({"spoilt": 1, "other": 2}) == {"augmented": 1, "other": 2}
    with pytest.raises(ConfigError, match="unknown key 'spoilt'"):
        build_config({"spoilt": 0.1, "augmented": 0.2}, Run)


def test_settings_are_toml_values_or_texts():
    assert parse_settings(["scenes=12", "clutter.lamps=0.5", "kind=planes", 'start="a=b"']) == {
        "scenes": 12,
        "clutter.lamps": 0.5,
        "kind": "planes",
        "start": "a=b",
    }
    with pytest.raises(ParameterError, match="--set: expected key=value, got 'scenes'"):
        parse_settings(["scenes"])
