"""What flickers in a shot whose maps are noisy: ``python -m benchmarks.experiments.flicker``.

A part of the demonstration's picture stands still, or is panned over by three pixels a frame. Its map carries
another draw in each frame: noise of 1 % of the range, and edges that stand up to one pixel aside, by blocks
of 8x8 pixels. Frames in the middle of the shot are rendered: from the maps as they are, each for itself;
repaired, each for itself; and from the steady maps of the shot. Printed are, in 1/255 of encoded light, the
rms over time of each pixel about its mean, the pan laid over itself by its known motion; the rms from frame
to frame; and the rms away from the pictures of the true maps. Last a focus pull through the true map: its
largest change from frame to frame over its median one.
"""

import argparse
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import numpy.typing as npt

import bokehnet
from bokehnet import BokehRenderer, RelativeDisparity, RenderSettings, make_scene, read_image
from bokehnet.depth_repair.repair_plan import RepairPlan, common_plan
from bokehnet.io.color.srgb import linear_to_srgb
from bokehnet.sequence.filtered_shot import FilteredShot

Array = npt.NDArray[np.float32]

_ASSETS = Path(bokehnet.__file__).parent / "assets"
_HEIGHT, _WIDTH, _TOP, _LEFT = 160, 240, 100, 60
_BLUR, _FOCUS, _BLOCK, _BORDER = 40.0, 0.35, 8, 24


def noisy(disparity: Array, rng: np.random.Generator) -> Array:
    """A map with noise, and edges up to one pixel aside."""
    height, width = disparity.shape
    aside = rng.integers(-1, 2, (2, -(-height // _BLOCK), -(-width // _BLOCK)))
    down, right = np.kron(aside, np.ones((1, _BLOCK, _BLOCK), int))[:, :height, :width]
    rows, columns = np.mgrid[:height, :width]
    moved = disparity[np.clip(rows + down, 0, height - 1), np.clip(columns + right, 0, width - 1)]
    return np.clip(moved + 0.01 * np.ptp(disparity) * rng.standard_normal(disparity.shape), 0, 1).astype("f4")


def encoded(image: Array) -> Array:
    """In 1/255 of encoded light."""
    return 255 * linear_to_srgb(np.clip(image, 0, 1))


def flicker(frames: list[Array]) -> tuple[float, float]:
    """Rms about the mean over time, and from frame to frame."""
    shot = np.stack(frames)
    return float(np.sqrt(shot.var(0).mean())), float(np.sqrt(np.square(np.diff(shot, axis=0)).mean()))


class Shot:
    """Frames of a camera that stands still or pans, with their true and noisy maps."""

    def __init__(self, frames: int, step: int) -> None:
        picture = read_image(_ASSETS / "demo.png")
        truth = np.asarray(linear_to_srgb(read_image(_ASSETS / "demo_disparity.png")[..., 0]), np.float32)
        rng, self.step = np.random.default_rng(0), step
        self.lefts = [_LEFT + step * t for t in range(frames)]
        self.images = [picture[_TOP : _TOP + _HEIGHT, x : x + _WIDTH] for x in self.lefts]
        self.truth = [truth[_TOP : _TOP + _HEIGHT, x : x + _WIDTH] for x in self.lefts]
        self.maps = [noisy(values, rng) for values in self.truth]

    def aligned(self, frames: dict[int, Array]) -> list[Array]:
        """What all of these frames show, at the same place in each, without the border."""
        left, right = max(self.lefts[t] for t in frames), min(self.lefts[t] for t in frames) + _WIDTH
        columns = {t: slice(left - self.lefts[t] + _BORDER, right - self.lefts[t] - _BORDER) for t in frames}
        return [frame[_BORDER:-_BORDER, columns[t]] for t, frame in frames.items()]


def render(
    renderer: BokehRenderer,
    shot: Shot,
    maps: list[Array],
    wanted: list[int],
    repair: str,
    plan: RepairPlan | None = None,
) -> tuple[dict[int, Array], list[RepairPlan]]:
    """Pictures by frame, and what the repair decided."""
    told = {"camera": {"blur": _BLUR}, "focus": {"value": _FOCUS}, "depth": {"repair": repair}}
    settings, pictures, plans = RenderSettings().updated(told), {}, []
    for t in wanted:
        scene = make_scene(shot.images[t], RelativeDisparity(map=maps[t], as_stored=True))
        focused = renderer.prepare(scene, settings, plan=plan)
        if focused.repair_plan is not None:
            plans.append(focused.repair_plan)
        pictures[t] = encoded(renderer.render(focused, settings).bokeh)
    return pictures, plans


def pull_evenness(renderer: BokehRenderer, frames: int) -> float:
    """Largest over median change from frame to frame of a focus pull from far to near."""
    shot, changes, before = Shot(1, 0), [], None
    told = {"camera": {"blur": _BLUR}, "focus": {"value": 0}, "depth": {"repair": "off"}}
    settings = RenderSettings().updated(told)
    scene = make_scene(shot.images[0], RelativeDisparity(map=shot.truth[0], as_stored=True))
    for focus in np.linspace(0.2, 0.6, frames):
        focused = replace(settings, focus=replace(settings.focus, value=float(focus)))
        now = encoded(renderer.render(scene, focused).bokeh)
        if before is not None:
            changes.append(float(np.sqrt(np.square(now - before).mean())))
        before = now
    return max(changes) / float(np.median(changes))


def told(name: str, label: str, shot: Shot, pictures: dict[int, Array], right: dict[int, Array]) -> None:
    """Print a row."""
    std, change = flicker(shot.aligned(pictures))
    away = np.sqrt(np.mean([np.square(pictures[t] - right[t]).mean() for t in pictures]))
    print(f"{name:16} {label:16} {std:6.2f} {change:6.2f} {away:6.2f}", flush=True)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description="What flickers in a shot whose maps are noisy.")
    parser.add_argument("--frames", type=int, default=48, help="of the shot; default 48")
    parser.add_argument("--rendered", type=int, default=6, help="in its middle; default 6")
    parser.add_argument("--engine", default="rays")
    parser.add_argument("--step", type=int, help="pixels a frame, alone; default 0, then 3")
    asked = parser.parse_args()
    renderer, first = BokehRenderer(asked.engine), (asked.frames - asked.rendered) // 2
    wanted = list(range(first, first + asked.rendered))
    for step in (0, 3) if asked.step is None else (asked.step,):
        name = f"pan of {step} pixels" if step else "static"
        shot = Shot(asked.frames, step)
        with tempfile.TemporaryDirectory() as folder:
            steady = FilteredShot(Path(folder))
            steady.filter(zip(shot.images, shot.maps, strict=True), asked.frames)
            maps = [np.clip(steady.read(t), 0, 1) for t in range(asked.frames)]
        rows = [
            ("each for itself", shot.maps, "off"),
            ("each repaired", shot.maps, "on"),
            ("steady", maps, "off"),
        ]
        right, _ = render(renderer, shot, shot.truth, wanted, "off")
        told(name, "true maps", shot, right, right)
        for label, values, repair in rows:
            told(name, label, shot, render(renderer, shot, values, wanted, repair)[0], right)
        plan = common_plan(render(renderer, shot, maps, wanted[:3], "auto")[1])
        pictures, _ = render(renderer, shot, maps, wanted, "auto", plan)
        told(name, "steady, planned", shot, pictures, right)
    print(f"focus pull: largest change {pull_evenness(renderer, 9):.2f} times the median one")


if __name__ == "__main__":
    main()
