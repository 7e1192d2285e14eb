"""The steps from nothing to all networks: what each makes, from what, by which command, in which time."""

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
from train.schedule import OptimConfig

__all__ = ["COMMANDS", "Recipe", "Step", "load_recipe"]

# Tools of the steps; trainings are called by their network.
COMMANDS = {
    "synth": ("bokehnet", "synth"),
    "prepare": ("python", "-m", "train.prepare"),
    "repair": ("python", "-m", "train.train_repair"),
    "error": ("python", "-m", "train.train_error"),
    "arnet": ("python", "-m", "train.train_arnet"),
    "iunet": ("python", "-m", "train.train_iunet"),
    "export": ("python", "-m", "train.export"),
    "evaluate": ("python", "-m", "train.evaluate"),
    "card": ("python", "-m", "train.card"),
}

# Option that names what a tool writes.
_TARGET = {"evaluate": "--json"}

# Tools that share their work among processes; the hours of the others are those of one core.
_SHARED = ("synth", "prepare")

# What a configuration names that some step has to make.
_MADE = re.compile(r"(?<![\w/.-])(data|runs)/.+")


@dataclass(frozen=True, kw_only=True)
class Step:
    """One command.

    Attributes:
        makes: Folder or file that it writes, as configurations name it: ``data/planes``, ``runs/repair``.
        by: The tool, one of ``COMMANDS``.
        config: Its TOML file, for tools that have one.
        settings: Values KEY=VALUE that replace some of it.
        words: Further words of the command.
        seconds: Time of one core for a unit of the work, measured: a scene, a step of training, all of it.
    """

    makes: str
    by: Literal["synth", "prepare", "repair", "error", "arnet", "iunet", "export", "evaluate", "card"]
    config: str = ""
    settings: tuple[str, ...] = ()
    words: tuple[str, ...] = ()
    seconds: float = 0.0

    @property
    def tool(self) -> tuple[str, ...]:
        """Words that start its tool."""
        return COMMANDS[self.by]

    @property
    def trains(self) -> bool:
        """Whether it trains a network."""
        return self.by in ("repair", "error", "arnet", "iunet")

    @property
    def shared(self) -> bool:
        """Whether its tool shares the work among processes, as many as it is told."""
        return self.by in _SHARED

    @property
    def overwrites(self) -> bool:
        """Whether its tool writes all anew, and does not go on with what is there."""
        return self.by in ("export", "evaluate", "card")


@dataclass(frozen=True, kw_only=True)
class Recipe:
    """All steps, in order.

    Attributes:
        workers: Steps that run side by side, and processes that make data; two cores are the reference.
        threads: Threads of a step that is not shared among processes; 0 takes its part of all cores.
        steps: What is done.
    """

    workers: int = 2
    threads: int = 0
    steps: tuple[Step, ...]

    def with_seed(self, seed: int) -> "Recipe":
        """The same with another seed of all trainings; the data stay as they are."""
        steps = [
            replace(step, settings=(*step.settings, f"optim.seed={seed}")) if step.trains else step
            for step in self.steps
        ]
        return replace(self, steps=tuple(steps))

    def with_share(self, share: float) -> "Recipe":
        """The same with that share of the scenes and of the steps of training, at least one of each.

        Raises:
            ParameterError: The share is not within (0, 1].
        """
        if not 0 < share <= 1:
            raise ParameterError("--share", "above 0 and at most 1", share)
        return replace(self, steps=tuple(self._lessened(step, share) for step in self.steps))

    def _lessened(self, step: Step, share: float) -> Step:
        table, asked = self.table(step), {}
        if step.by == "synth":
            asked = {"scenes": table["scenes"]}
        elif step.trains:
            optim = table["optim"]
            asked = {"optim.steps": optim["steps"], "optim.warmup": optim.get("warmup", OptimConfig.warmup)}
        less = [f"{key}={max(1, math.ceil(share * count))}" for key, count in asked.items()]
        return replace(step, settings=(*step.settings, *less))

    def table(self, step: Step) -> dict[str, Any]:
        """Plain values of a step's configuration, its settings included; empty if it has none."""
        return _table(step.config, step.settings) if step.config else {}

    def units(self, step: Step) -> int:
        """Scenes or steps of training that a step goes through; 1 for what has neither."""
        table = self.table(step)
        if step.by == "synth":
            return int(table["scenes"])
        if step.by in ("prepare", "evaluate"):
            return sum(self.units(need) for need in self.needs(step) if need.by == "synth")
        return int(table["optim"]["steps"]) if step.trains else 1

    def work(self, step: Step) -> float:
        """Expected time of a step on one core."""
        return self.units(step) * step.seconds

    def seconds(self, step: Step) -> float:
        """Expected time of a step."""
        return self.work(step) / (self.workers if step.shared else 1)

    def needs(self, step: Step) -> list[Step]:
        """The steps whose results a step reads."""
        texts = [text for _, text in self._texts(step)]
        return [other for other in self.steps if any(_pattern(other.makes).search(text) for text in texts)]

    def _texts(self, step: Step) -> list[tuple[str, str]]:
        """All texts of a step that may name what others make, with their keys."""
        return [*_texts(self.table(step)), *(("words", word) for word in step.words)]

    def command(
        self, step: Step, root: Path | None = None, ray: str | None = None, workers: int | None = None
    ) -> list[str]:
        """Words of a step's command.

        Args:
            step: Which.
            root: Folder in which everything is made; as the configurations name it without one.
            ray: Address of a Ray cluster that renders the scenes.
            workers: Processes that make data, other than the recipe's.
        """
        words = [*step.tool, *(["--config", step.config] if step.config else [])]
        words += [self._rooted(word, root) for word in step.words]
        words += [_TARGET.get(step.by, "--out"), self._rooted(step.makes, root)]
        if step.shared:
            words += ["--workers", str(workers or self.workers)]
        if step.by == "synth" and ray is not None:
            words += ["--ray", ray]
        for setting in self._settings(step, root):
            words += ["--set", setting]
        return words

    def fingerprint(self, step: Step, with_needs: bool = True) -> str:
        """Text that changes when something else is asked for than before, by a step or by those it needs."""
        asked = [step.by, step.makes, step.words, self.table(step)]
        needs = [self.fingerprint(need) for need in self.needs(step)] if with_needs else []
        return hashlib.sha256(json.dumps([*asked, needs], sort_keys=True).encode()).hexdigest()

    def check(self) -> None:
        """Raise ``ConfigError`` unless every step finds what it reads among the steps before it."""
        made: list[str] = []
        for number, step in enumerate(self.steps):
            later = [other.makes for other in self.steps[number:]]
            if step.makes in made:
                raise ConfigError(f"steps: two of them make {step.makes}; give one another name")
            for key, text in self._texts(step):
                found, too_early = (any(_pattern(path).search(text) for path in x) for x in (made, later))
                if too_early or (_MADE.search(text) and not found):
                    raise ConfigError(
                        f"{step.config or step.makes}: {key} asks for {text}, which no step before "
                        f"{step.makes} makes; add one or correct the path"
                    )
            made.append(step.makes)

    def _settings(self, step: Step, root: Path | None) -> Iterable[str]:
        """What replaces values of a step's configuration, with paths below ``root``."""
        given = {setting.partition("=")[0]: setting for setting in step.settings}
        for key, value in _leaves(self.table(step)):
            if isinstance(value, list):
                moved: Any = [self._rooted(x, root) if isinstance(x, str) else x for x in value]
            else:
                moved = self._rooted(value, root) if isinstance(value, str) else value
            if moved != value:
                given[key] = f"{key}={json.dumps(moved)}"  # JSON's texts and lists are TOML's, too
        return given.values()

    def _rooted(self, text: str, root: Path | None) -> str:
        """``text`` with every path that a step makes moved below ``root``."""
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
        place = table
        for key in path:
            place = place.setdefault(key, {})
        place[last] = tomllib.loads(f"value = {text}")["value"]
    return table


def _pattern(path: str) -> re.Pattern[str]:
    """``path`` as a whole, with or without something below it, and not as a part of a longer one."""
    return re.compile(rf"(?<![\w/.-]){re.escape(path)}(?![\w.-])")


def _leaves(table: dict[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Dotted keys and values of a table."""
    for key, value in table.items():
        if isinstance(value, dict):
            yield from _leaves(value, f"{prefix}{key}.")
        else:
            yield prefix + key, value


def _texts(table: dict[str, Any]) -> Iterator[tuple[str, str]]:
    """Dotted keys and texts of a table, those in lists too."""
    for key, value in _leaves(table):
        for item in value if isinstance(value, list) else [value]:
            if isinstance(item, str):
                yield key, item


def load_recipe(path: Path) -> Recipe:
    """Read and check a recipe.

    Raises:
        ConfigError: A file is missing or wrong, or a step reads what none before it makes.
    """
    recipe = load_config(path, Recipe)
    try:
        recipe.check()
        for step in recipe.steps:
            recipe.units(step)
    except OSError as error:
        raise ConfigError(f"{path}: cannot read {error.filename}: {error.strerror}") from error
    except tomllib.TOMLDecodeError as error:
        raise ConfigError(f"{path}: a configuration that it names is no TOML: {error}") from error
    except (KeyError, ValueError) as error:
        if isinstance(error, ConfigError):
            raise
        raise ConfigError(f"{path}: a configuration that it names lacks {error}") from error
    return recipe
