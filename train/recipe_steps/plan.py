"""Plan of a recipe: the output, inputs, command and expected time of each step."""

import hashlib
import json
import math
import re
import tomllib
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any, Literal

from bokehnet.config import load_config
from bokehnet.errors import ConfigError, ParameterError
from train.run.schedule import OptimConfig

__all__ = ["COMMANDS", "Recipe", "Step", "load_recipe"]

# Commands of the tools; a training has the name of its network.
COMMANDS = {
    "synth": ("bokehnet", "synth"),
    "prepare": ("python", "-m", "train.prepare"),
    "error": ("python", "-m", "train.train_error"),
    "prepare_light": ("python", "-m", "train.prepare_light"),
    "light": ("python", "-m", "train.train_light"),
    "arnet": ("python", "-m", "train.train_arnet"),
    "iunet": ("python", "-m", "train.train_iunet"),
    "bokehme": ("python", "-m", "train.train_bokehme"),
    "export": ("python", "-m", "train.export"),
    "evaluate": ("python", "-m", "train.evaluate"),
    "card": ("python", "-m", "train.card"),
}

# Option that names a tool's output, where it is not --out.
_OUTPUT_OPTION = {"evaluate": "--json"}

# Tools that split their work among processes; the times of the others refer to one core.
_SHARED = ("synth", "prepare", "prepare_light")

# Paths in a configuration that must be the output of some step.
_OUTPUT_PATH = re.compile(r"(?<![\w/.-])(data|runs)/.+")


@dataclass(frozen=True, kw_only=True)
class Step:
    """One command of a recipe.

    Attributes:
        makes: Output folder or file, as configurations name it: ``data/planes``, ``runs/arnet``.
        by: Tool, one of ``COMMANDS``.
        config: TOML file of the tool; empty for tools without one.
        settings: Overrides KEY=VALUE of the configuration.
        words: Further arguments of the command.
        seconds: Measured time on one core per unit of work, seconds; the unit is a scene, a training step or
            the whole command.
    """

    makes: str
    by: Literal[
        "synth",
        "prepare",
        "error",
        "prepare_light",
        "light",
        "arnet",
        "iunet",
        "bokehme",
        "export",
        "evaluate",
        "card",
    ]
    config: str = ""
    settings: tuple[str, ...] = ()
    words: tuple[str, ...] = ()
    seconds: float = 0.0

    @property
    def tool(self) -> tuple[str, ...]:
        """Words of the command that starts the tool."""
        return COMMANDS[self.by]

    @property
    def trains(self) -> bool:
        """True if the step trains a network."""
        return self.by in ("error", "light", "arnet", "iunet", "bokehme")

    @property
    def shared(self) -> bool:
        """True if the tool splits its work among a given number of processes."""
        return self.by in _SHARED

    @property
    def overwrites(self) -> bool:
        """True if the tool overwrites its output and does not resume."""
        return self.by in ("export", "evaluate", "card")


@dataclass(frozen=True, kw_only=True)
class Recipe:
    """All steps, in order.

    Attributes:
        workers: Number of steps in parallel, and of processes that make data; the reference has two cores.
        threads: Threads of a step without own processes; 0 divides all cores equally.
        steps: Steps of the recipe.
    """

    workers: int = 2
    threads: int = 0
    steps: tuple[Step, ...]

    def with_seed(self, seed: int) -> "Recipe":
        """Return the recipe with another seed for all trainings; the data stay the same."""
        steps = [
            replace(step, settings=(*step.settings, f"optim.seed={seed}")) if step.trains else step
            for step in self.steps
        ]
        return replace(self, steps=tuple(steps))

    def with_share(self, share: float) -> "Recipe":
        """Return the recipe with a fraction of the scenes and training steps, at least one of each.

        Raises:
            ParameterError: The share is not within (0, 1].
        """
        if not 0 < share <= 1:
            raise ParameterError("--share", "above 0 and at most 1", share)
        return replace(self, steps=tuple(self._reduced(step, share) for step in self.steps))

    def _reduced(self, step: Step, share: float) -> Step:
        table, counts = self.table(step), {}
        if step.by in ("synth", "prepare_light"):
            counts = {"scenes": table["scenes"]}
        elif step.trains:
            optim = table["optim"]
            counts = {"optim.steps": optim["steps"], "optim.warmup": optim.get("warmup", OptimConfig.warmup)}
        overrides = [f"{key}={max(1, math.ceil(share * count))}" for key, count in counts.items()]
        return replace(step, settings=(*step.settings, *overrides))

    def table(self, step: Step) -> dict[str, Any]:
        """Return a step's configuration with its overrides as plain values; empty without one."""
        return _table(step.config, step.settings) if step.config else {}

    def units(self, step: Step) -> int:
        """Return the number of scenes or training steps of a step; 1 for other steps."""
        table = self.table(step)
        if step.by in ("synth", "prepare_light"):
            return int(table["scenes"])
        if step.by in ("prepare", "evaluate"):
            return sum(self.units(need) for need in self.needs(step) if need.by == "synth")
        return int(table["optim"]["steps"]) if step.trains else 1

    def work(self, step: Step) -> float:
        """Return the expected time of a step on one core, seconds."""
        return self.units(step) * step.seconds

    def seconds(self, step: Step) -> float:
        """Return the expected time of a step, seconds."""
        return self.work(step) / (self.workers if step.shared else 1)

    def needs(self, step: Step) -> list[Step]:
        """Return the steps whose outputs a step reads."""
        texts = [text for _, text in self._texts(step)]
        return [other for other in self.steps if any(_pattern(other.makes).search(text) for text in texts)]

    def _texts(self, step: Step) -> list[tuple[str, str]]:
        """Return the texts of a step that can name outputs of other steps, with their keys."""
        return [*_texts(self.table(step)), *(("words", word) for word in step.words)]

    def command(
        self, step: Step, root: Path | None = None, ray: str | None = None, workers: int | None = None
    ) -> list[str]:
        """Return the words of a step's command.

        Args:
            step: Step of this recipe.
            root: Folder of all outputs; ``None`` keeps the paths of the configurations.
            ray: Address of a Ray cluster that renders the scenes.
            workers: Number of processes that make data; default: that of the recipe.
        """
        words = [*step.tool, *(["--config", step.config] if step.config else [])]
        words += [self._rooted(word, root) for word in step.words]
        words += [_OUTPUT_OPTION.get(step.by, "--out"), self._rooted(step.makes, root)]
        if step.shared:
            words += ["--workers", str(workers or self.workers)]
        if step.by == "synth" and ray is not None:
            words += ["--ray", ray]
        for setting in self._settings(step, root):
            words += ["--set", setting]
        return words

    def fingerprint(self, step: Step, with_needs: bool = True) -> str:
        """Return a hash of the definition of a step and, optionally, of the steps whose outputs it reads."""
        definition = [step.by, step.makes, step.words, self.table(step)]
        needs = [self.fingerprint(need) for need in self.needs(step)] if with_needs else []
        return hashlib.sha256(json.dumps([*definition, needs], sort_keys=True).encode()).hexdigest()

    def check(self) -> None:
        """Raise ``ConfigError`` unless earlier steps make all inputs of every step."""
        outputs: list[str] = []
        for number, step in enumerate(self.steps):
            later = [other.makes for other in self.steps[number:]]
            if step.makes in outputs:
                raise ConfigError(
                    f"steps: expected different outputs, found two steps that make {step.makes}; rename one"
                )
            for key, text in self._texts(step):
                available, too_early = (
                    any(_pattern(path).search(text) for path in x) for x in (outputs, later)
                )
                if too_early or (_OUTPUT_PATH.search(text) and not available):
                    raise ConfigError(
                        f"{step.config or step.makes}: {key} names {text}, which no step before "
                        f"{step.makes} makes; add one or correct the path"
                    )
            outputs.append(step.makes)

    def _settings(self, step: Step, root: Path | None) -> Iterable[str]:
        """Return the overrides of a step's configuration, with paths below ``root``."""
        overrides = {setting.partition("=")[0]: setting for setting in step.settings}
        for key, value in _leaves(self.table(step)):
            if isinstance(value, list):
                rooted: Any = [self._rooted(x, root) if isinstance(x, str) else x for x in value]
            else:
                rooted = self._rooted(value, root) if isinstance(value, str) else value
            if rooted != value:
                overrides[key] = f"{key}={json.dumps(rooted)}"  # JSON strings and lists are valid TOML
        return overrides.values()

    def _rooted(self, text: str, root: Path | None) -> str:
        """Return ``text`` with the output paths of all steps moved below ``root``."""
        if root is None:
            return text
        for step in self.steps:
            path = step.makes.removeprefix("bokehnet/")
            text = _pattern(step.makes).sub(lambda _, path=path: str(root / path), text)
        return text


@cache
def _table(config: str, settings: tuple[str, ...]) -> dict[str, Any]:
    table = tomllib.loads(Path(config).read_text(encoding="utf-8"))
    for setting in settings:
        keys, _, text = setting.partition("=")
        *path, last = keys.split(".")
        table_at_path = table
        for key in path:
            table_at_path = table_at_path.setdefault(key, {})
        table_at_path[last] = tomllib.loads(f"value = {text}")["value"]
    return table


def _pattern(path: str) -> re.Pattern[str]:
    """Return a pattern of ``path`` or a path below it, but not inside a longer name."""
    return re.compile(rf"(?<![\w/.-]){re.escape(path)}(?![\w.-])")


def _leaves(table: dict[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Iterate over the dotted keys and values of a table."""
    for key, value in table.items():
        if isinstance(value, dict):
            yield from _leaves(value, f"{prefix}{key}.")
        else:
            yield prefix + key, value


def _texts(table: dict[str, Any]) -> Iterator[tuple[str, str]]:
    """Iterate over the dotted keys and strings of a table, including strings in lists."""
    for key, value in _leaves(table):
        for item in value if isinstance(value, list) else [value]:
            if isinstance(item, str):
                yield key, item


def load_recipe(path: Path) -> Recipe:
    """Read and check a recipe.

    Raises:
        ConfigError: A file is missing or invalid, or no earlier step makes an input of a step.
    """
    recipe = load_config(path, Recipe)
    try:
        recipe.check()
        for step in recipe.steps:
            recipe.units(step)
    except OSError as error:
        raise ConfigError(f"{path}: cannot read {error.filename}: {error.strerror}") from error
    except tomllib.TOMLDecodeError as error:
        raise ConfigError(f"{path}: a configuration that it names is not valid TOML: {error}") from error
    except (KeyError, ValueError) as error:
        if isinstance(error, ConfigError):
            raise
        raise ConfigError(f"{path}: a configuration that it names lacks {error}") from error
    return recipe
