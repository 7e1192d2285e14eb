"""Flicker of a shot with noisy maps: ``python -m benchmarks.experiments.edges.flicker``.

Uses a static crop of the demo picture, or a pan by three pixels per frame. Its map has independent errors in
each frame: noise of 1 % of the range, and edges displaced by up to one pixel in blocks of 8x8 pixels. Renders
frames in the middle of the shot from the unprocessed maps; from maps repaired frame by frame; and from the
temporally filtered maps of the shot. Prints, in 1/255 of encoded light, the rms over time of each pixel about
its mean, with the pan aligned by its known motion; the rms from frame to frame; and the rms difference to the
pictures of the true maps. Finally prints, for a focus pull with the true map, the largest change from frame
to frame over the median change.
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
    """Return a map with noise and edges displaced by up to one pixel."""
    height, width = disparity.shape
    displacement = rng.integers(-1, 2, (2, -(-height // _BLOCK), -(-width // _BLOCK)))
    down, reference = np.kron(displacement, np.ones((1, _BLOCK, _BLOCK), int))[:, :height, :width]
    rows, columns = np.mgrid[:height, :width]
    displaced = disparity[np.clip(rows + down, 0, height - 1), np.clip(columns + reference, 0, width - 1)]
    return np.clip(displaced + 0.01 * np.ptp(disparity) * rng.standard_normal(disparity.shape), 0, 1).astype(
        "f4"
    )


def encoded(image: Array) -> Array:
    """Return encoded light in 1/255."""
    return 255 * linear_to_srgb(np.clip(image, 0, 1))


def flicker(frames: list[Array]) -> tuple[float, float]:
    """Return the rms about the mean over time, and from frame to frame."""
    shot = np.stack(frames)
    return float(np.sqrt(shot.var(0).mean())), float(np.sqrt(np.square(np.diff(shot, axis=0)).mean()))


class Shot:
    """Frames of a static or panning camera, with their true and noisy maps."""

    def __init__(self, frames: int, step: int) -> None:
        picture = read_image(_ASSETS / "demo.png")
        truth = np.asarray(linear_to_srgb(read_image(_ASSETS / "demo_disparity.png")[..., 0]), np.float32)
        rng, self.step = np.random.default_rng(0), step
        self.lefts = [_LEFT + step * t for t in range(frames)]
        self.images = [picture[_TOP : _TOP + _HEIGHT, x : x + _WIDTH] for x in self.lefts]
        self.truth = [truth[_TOP : _TOP + _HEIGHT, x : x + _WIDTH] for x in self.lefts]
        self.maps = [noisy(values, rng) for values in self.truth]

    def aligned(self, frames: dict[int, Array]) -> list[Array]:
        """Return the common region of the frames, aligned, without the border."""
        left, reference = max(self.lefts[t] for t in frames), min(self.lefts[t] for t in frames) + _WIDTH
        columns = {
            t: slice(left - self.lefts[t] + _BORDER, reference - self.lefts[t] - _BORDER) for t in frames
        }
        return [frame[_BORDER:-_BORDER, columns[t]] for t, frame in frames.items()]


def render(
    renderer: BokehRenderer,
    shot: Shot,
    maps: list[Array],
    frame_numbers: list[int],
    repair: str,
    plan: RepairPlan | None = None,
) -> tuple[dict[int, Array], list[RepairPlan]]:
    """Return pictures by frame, and the repair plans."""
    overrides = {"camera": {"blur": _BLUR}, "focus": {"value": _FOCUS}, "depth": {"repair": repair}}
    settings, pictures, plans = RenderSettings().updated(overrides), {}, []
    for t in frame_numbers:
        scene = make_scene(shot.images[t], RelativeDisparity(map=maps[t], as_stored=True))
        focused = renderer.prepare(scene, settings, plan=plan)
        if focused.repair_plan is not None:
            plans.append(focused.repair_plan)
        pictures[t] = encoded(renderer.render(focused, settings).bokeh)
    return pictures, plans


def pull_evenness(renderer: BokehRenderer, frames: int) -> float:
    """Return the largest over the median change from frame to frame of a focus pull from far to near."""
    shot, changes, before = Shot(1, 0), [], None
    overrides = {"camera": {"blur": _BLUR}, "focus": {"value": 0}, "depth": {"repair": "off"}}
    settings = RenderSettings().updated(overrides)
    scene = make_scene(shot.images[0], RelativeDisparity(map=shot.truth[0], as_stored=True))
    for focus in np.linspace(0.2, 0.6, frames):
        focused = replace(settings, focus=replace(settings.focus, value=float(focus)))
        now = encoded(renderer.render(scene, focused).bokeh)
        if before is not None:
            changes.append(float(np.sqrt(np.square(now - before).mean())))
        before = now
    return max(changes) / float(np.median(changes))


def print_row(
    name: str, label: str, shot: Shot, pictures: dict[int, Array], reference: dict[int, Array]
) -> None:
    """Print a row."""
    std, change = flicker(shot.aligned(pictures))
    difference = np.sqrt(np.mean([np.square(pictures[t] - reference[t]).mean() for t in pictures]))
    print(f"{name:16} {label:16} {std:6.2f} {change:6.2f} {difference:6.2f}", flush=True)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description="Flicker of a shot with noisy maps.")
    parser.add_argument("--frames", type=int, default=48, help="frames of the shot; default 48")
    parser.add_argument("--rendered", type=int, default=6, help="rendered frames in its middle; default 6")
    parser.add_argument("--engine", default="rays")
    parser.add_argument("--step", type=int, help="pan in pixels per frame; default: both 0 and 3")
    arguments = parser.parse_args()
    renderer, first = BokehRenderer(arguments.engine), (arguments.frames - arguments.rendered) // 2
    frame_numbers = list(range(first, first + arguments.rendered))
    for step in (0, 3) if arguments.step is None else (arguments.step,):
        name = f"pan of {step} pixels" if step else "static"
        shot = Shot(arguments.frames, step)
        with tempfile.TemporaryDirectory() as folder:
            steady = FilteredShot(Path(folder))
            steady.filter(zip(shot.images, shot.maps, strict=True), range(arguments.frames))
            maps = [np.clip(steady.read(t), 0, 1) for t in range(arguments.frames)]
        rows = [
            ("each for itself", shot.maps, "off"),
            ("each repaired", shot.maps, "on"),
            ("steady", maps, "off"),
        ]
        reference, _ = render(renderer, shot, shot.truth, frame_numbers, "off")
        print_row(name, "true maps", shot, reference, reference)
        for label, values, repair in rows:
            print_row(name, label, shot, render(renderer, shot, values, frame_numbers, repair)[0], reference)
        plan = common_plan(render(renderer, shot, shot.maps, frame_numbers[:3], "auto")[1])
        plan = replace(plan, noise=None)
        pictures, _ = render(renderer, shot, maps, frame_numbers, "auto", plan)
        print_row(name, "steady, planned", shot, pictures, reference)
    print(f"focus pull: largest change {pull_evenness(renderer, 9):.2f} times the median one")


if __name__ == "__main__":
    main()
