"""Disparity repair without torch: the edges of an imperfect map moved to where the picture has them."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, get_args

import numpy as np
import numpy.typing as npt

from bokehnet.checks import check_choice, check_image, check_map, check_same_size
from bokehnet.inference.alike_median import settle_soft_steps, soft_steps
from bokehnet.inference.disparity_edges import (
    SOFT,
    STEP,
    repair_soft_edges,
    soft_edge_fraction,
)
from bokehnet.inference.disparity_tiles import BLOCK, HALO, TILE, repair_tiles
from bokehnet.inference.disparity_upsample import align_steps
from bokehnet.inference.edge_bias import busiest_windows, find_edge_bias, shift_edges, stands_right
from bokehnet.inference.lost_lines import restore_lost_lines
from bokehnet.inference.memory import give_back, keeps_freed
from bokehnet.inference.overshoots import without_overshoots
from bokehnet.inference.repair_plan import RepairPlan
from bokehnet.inference.session import WEIGHTS, load_network
from bokehnet.inference.soft_maps import explain_soft_map, find_softness
from bokehnet.io.row_blocks import Progress, make_in_row_blocks
from bokehnet.pyramid import crop_to, downsample2, pad_to_multiple, upsample2

__all__ = [
    "REPAIR_MODES",
    "DisparityRepair",
    "RepairMode",
    "RepairedMap",
    "misplaced_edge_fraction",
    "network_memory",
]

RepairMode = Literal["auto", "on", "off"]
REPAIR_MODES = get_args(RepairMode)

# Bytes that the network takes for a pixel that it sees at once.
_NETWORK_BYTES = 480

# Rows looked at together where the whole map is looked through.
_BLOCK_ROWS = 1024

# Pictures with longer sides are repaired at half their size first: their maps are off by more pixels.
_LARGEST_SIDE = 1024

# Longest side of the sizes at which the network looks. What it found there is enlarged and put to the edges
# of the larger picture, which on path-traced scenes of four times the size places more pixels right than
# the network does (docs/large.md).
_NETWORK_SIDE = 2048

# What the network costs for a pixel, over what it costs to put a step there to the picture's edge.
_COSTLY = 10

# Share of soft steps from which on those are put where the picture's colours part.
_RAMPS = 0.1

# Share of the pixels at steps that stand out of place from which on "auto" takes the repaired map.
_IMPERFECT = 0.01

# That share below which "auto" takes the busiest windows' word for the whole map.
_SURELY_RIGHT = 0.005


def _step_sizes(disparity: np.ndarray) -> np.ndarray:
    """Span of the map in the 3x3 blocks of ``BLOCK`` pixels around each block, (H / 8, W / 8)."""
    height, width = disparity.shape
    blocks = disparity.reshape(height // BLOCK, BLOCK, width // BLOCK, BLOCK)
    low, high = np.pad(blocks.min(1).min(2), 1, "edge"), np.pad(blocks.max(1).max(2), 1, "edge")
    rows, columns = blocks.shape[0], blocks.shape[2]
    windows = [(slice(y, y + rows), slice(x, x + columns)) for y in range(3) for x in range(3)]
    span: np.ndarray = np.max([high[w] for w in windows], 0) - np.min([low[w] for w in windows], 0)
    return span


def misplaced_edge_fraction(disparity: np.ndarray, repaired: np.ndarray) -> float:
    """How much of a map's steps the repair moved: 0 = all stood right, up to 1.

    Args:
        disparity: As it was, (H, W).
        repaired: As it is, (H, W).

    Returns:
        Share, of the pixels near steps, that changed by more than a quarter of the step.
    """
    near, moved = _count_moved(disparity, repaired, STEP * float(np.ptp(disparity)))
    return moved / max(near, 1)


def _count_moved(disparity: np.ndarray, repaired: np.ndarray, least: float) -> tuple[int, int]:
    """Pixels near steps of at least ``least``, and how many of them changed by over a quarter of theirs."""
    spans = _step_sizes(pad_to_multiple(disparity, BLOCK))
    near = moved = 0
    for top in range(0, len(disparity), _BLOCK_ROWS):
        rows = slice(top, top + _BLOCK_ROWS)
        was, now = disparity[rows], repaired[rows]
        blocks = spans[top // BLOCK : (top + _BLOCK_ROWS) // BLOCK]
        steps = blocks.repeat(BLOCK, 0).repeat(BLOCK, 1)[: len(was), : was.shape[1]]
        at_steps = steps > least
        near += int(at_steps.sum())
        moved += int((at_steps & (np.abs(now - was) > 0.25 * steps)).sum())
    return near, moved


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class RepairedMap:
    """What the repair made of a map.

    Attributes:
        disparity: (H, W), in the unit of the input; never the same array.
        repaired: Whether edges were moved.
        reason: Why, or why not, in a few words.
        plan: What was decided; None where nothing was looked at.
    """

    disparity: npt.NDArray[np.float32]
    repaired: bool
    reason: str
    plan: RepairPlan | None = None


def network_memory(height: int, width: int) -> int:
    """Bytes that the network takes while it looks at a picture of that size."""
    return _NETWORK_BYTES * min(height * width, TILE)


@dataclass(frozen=True, slots=True)
class _SoftMap:
    """A map with soft steps.

    Attributes:
        steps: Where they are, (H, W) bool.
        given: The map, (H, W).
    """

    steps: np.ndarray
    given: np.ndarray

    def half(self) -> "_SoftMap":
        """The same at half its size."""
        return _SoftMap(_half_mask(self.steps), _half_map(self.given))

    def settle(self, image: np.ndarray, repaired: np.ndarray, span: float) -> np.ndarray:
        """Put into a repaired map (H, W) what it lacks, and its steps where the colours of (H, W, 3) part."""
        deviation = find_softness(self.given, repaired, self.steps)
        if deviation:
            repaired = explain_soft_map(image, self.given, repaired, deviation)
        return settle_soft_steps(image, repaired, self.steps, span)


class _Work:
    """How far the repair is, by what its sizes cost; the smallest one comes first.

    Args:
        shapes: Of the picture at each size, (3, H, W), the largest first.
        progress: Is told of it.

    Attributes:
        last_look: How many sizes are smaller than the largest one at which the network looks.
        is_large: Whether there are several sizes.
    """

    def __init__(self, shapes: Sequence[tuple[int, ...]], progress: Progress | None) -> None:
        smallest = len(shapes) - 1
        looks = [max(shape) <= _NETWORK_SIDE or at == smallest for at, shape in enumerate(shapes)]
        self.last_look, self.is_large = smallest - looks.index(True), smallest > 0
        self._costs = [
            height * width * (_COSTLY if look else 1)
            for look, (_, height, width) in zip(looks, shapes, strict=True)
        ]
        self._progress = progress

    def report(self, smaller: int, share: float) -> None:
        """Tell that this share of a size is done, and all of those that are ``smaller``, so many."""
        if self._progress is not None:
            at = len(self._costs) - 1 - smaller
            done = sum(self._costs[at + 1 :]) + share * self._costs[at]
            self._progress(round(1000 * done / sum(self._costs)), 1000)


class DisparityRepair:
    """Repairs disparity maps on the CPU.

    Args:
        weights: Folder with the network and its manifest; the package's own by default.
        threads: Threads inside the network; 0 takes all cores.

    Raises:
        ModelFileError: The network is missing or damaged.
    """

    def __init__(self, weights: Path | None = None, threads: int = 0) -> None:
        folder = weights or WEIGHTS / "repair"
        self._network = load_network(folder, "repair", ("image", "disparity", "span"), threads)

    def __call__(
        self,
        image: npt.NDArray[np.floating],
        disparity: npt.NDArray[np.floating],
        mode: RepairMode = "on",
    ) -> npt.NDArray[np.float32]:
        """Return the map with sharp edges where the picture has them; see :meth:`repair`."""
        return self.repair(image, disparity, mode).disparity

    def repair(
        self,
        image: npt.NDArray[np.floating],
        disparity: npt.NDArray[np.floating],
        mode: RepairMode = "on",
        progress: Progress | None = None,
        plan: RepairPlan | None = None,
    ) -> RepairedMap:
        """Move the edges of a map to where the picture has them, and say whether it was done.

        Every value stays within those nearby, so that flat regions remain as they are; where a soft map
        lacks what blur has hidden (:mod:`bokehnet.inference.soft_maps`), within those of the map. Maps of
        large pictures are repaired at half the size first. Memory beyond input and output is that of a
        tile and a third of the picture.

        Args:
            image: All-in-focus picture, scene-linear, (H, W, 3).
            disparity: (H, W), any unit and offset, rising towards the camera; a defocus map will do.
            mode: "on"; "auto" returns the map as it is where nearly all of its steps stand right already;
                "off" always does.
            progress: Called with (steps done, steps in all); what it raises ends the repair.
            plan: What the shot has decided; "auto" follows it. Default: all is decided by this map.

        Raises:
            ShapeError: Not (H, W, 3) and (H, W) of one size.
            ParameterError: NaN or infinity in either, or an unknown mode.
        """
        check_choice("mode", mode, REPAIR_MODES)
        check_image("image", image)
        check_map("disparity", disparity)
        check_same_size("image", image, "disparity", disparity)
        image, disparity = (np.asarray(x, np.float32) for x in (image, disparity))
        span = float(disparity.max()) - float(disparity.min())
        if span == 0 or mode == "off":
            reason = "switched off" if mode == "off" else "the map is constant"
            return RepairedMap(disparity=disparity.copy(), repaired=False, reason=reason)
        if plan is not None and mode == "auto":
            if not plan.repaired:
                reason = "as most of the shot"
                return RepairedMap(disparity=disparity.copy(), repaired=False, reason=reason, plan=plan)
            mode = "on"
        softness = soft_edge_fraction(disparity) if plan is None else plan.softness
        start = given = disparity
        if softness > SOFT:
            given = without_overshoots(disparity)
            start = repair_soft_edges(given)
        if image.min() < 0:
            image = np.maximum(image, 0)
        sizes = [image.transpose(2, 0, 1)]
        if mode == "auto" and start is disparity and self._stands_right(sizes[0], disparity, span):
            right = RepairPlan(repaired=False, softness=softness, shift=0)
            reason = "its edges stand right"
            return RepairedMap(disparity=disparity.copy(), repaired=False, reason=reason, plan=right)
        while max(sizes[-1].shape) > _LARGEST_SIDE:
            sizes.append(_half(sizes[-1]))
        work = _Work([x.shape for x in sizes], progress)
        if plan is None:
            shift, smallest = self._edge_bias(sizes, start, span, work)
        else:
            shift, smallest = plan.shift, None
        maps = [shift_edges(start, shift)]
        del start
        soft = _SoftMap(soft_steps(given), given) if softness > _RAMPS else None
        repaired = self._repair(sizes, maps, span, work, None if shift else smallest, soft)
        if mode == "on":
            reason = "asked for" if plan is None else "as most of the shot"
            found = RepairPlan(repaired=True, softness=softness, shift=shift)
            return RepairedMap(disparity=repaired, repaired=True, reason=reason, plan=found)
        misplaced = misplaced_edge_fraction(disparity, repaired)
        share = f"{100 * misplaced:.2g} % of its edges stood out of place"
        found = RepairPlan(repaired=misplaced >= _IMPERFECT, softness=softness, shift=shift)
        if misplaced < _IMPERFECT:
            return RepairedMap(disparity=disparity.copy(), repaired=False, reason=f"only {share}", plan=found)
        return RepairedMap(disparity=repaired, repaired=True, reason=share, plan=found)

    def _stands_right(self, image: np.ndarray, disparity: np.ndarray, span: float) -> bool:
        """Whether the repair moves next to nothing in those parts of the picture that hold the most steps."""
        disparity = pad_to_multiple(disparity, BLOCK)
        counts = [
            _count_moved(
                disparity[window], self._run(image[:, *window], disparity[window], span)[0], STEP * span
            )
            for window in busiest_windows(_step_sizes(disparity) > STEP * span)
        ]
        near, moved = np.sum(counts, 0) if counts else (0, 0)
        return bool(moved < _SURELY_RIGHT * max(near, 1))

    def _edge_bias(
        self, sizes: Sequence[np.ndarray], disparity: np.ndarray, span: float, work: "_Work"
    ) -> tuple[int, np.ndarray]:
        """Pixels by which near things should grow everywhere, found at the smallest of the sizes.

        Also returns the repaired map of that size, from which this is seen where they should not.
        """
        for _ in sizes[1:]:
            disparity = _half_map(disparity)
        repaired, found = self._look(sizes[-1], disparity, span, work, 0)
        if stands_right(found):
            return 0, repaired
        disparity = pad_to_multiple(disparity, BLOCK)

        def votes(window: tuple[slice, slice], moved: np.ndarray) -> np.ndarray:
            found: np.ndarray = self._run(sizes[-1][:, *window], moved, span)[1][0]
            return found

        busy = _step_sizes(disparity) > STEP * span
        return 2 ** (len(sizes) - 1) * find_edge_bias(disparity, busy, votes), repaired

    def _run(self, image: np.ndarray, disparity: np.ndarray, span: float) -> tuple[np.ndarray, np.ndarray]:
        """Repaired disparity (H, W) of a part whose sides are multiples of a block, and votes (1, 4)."""
        # The picture may end within the last block of the map.
        fed = pad_to_multiple(image[None], BLOCK), disparity[None, None]
        repaired, votes = self._network(*fed, np.full((1, 1, 1, 1), span, np.float32))
        return repaired[0, 0], votes

    def _give_back(self) -> None:
        """Return the memory of the network's layers to the system, where the process does not keep it."""
        if keeps_freed():
            return
        block = np.zeros((1, 3, BLOCK, BLOCK), np.float32)
        self._network(block, block[:, :1], np.ones((1, 1, 1, 1), np.float32), release=True)
        give_back()

    def _repair(
        self,
        sizes: list[np.ndarray],
        maps: list[np.ndarray],
        span: float,
        work: "_Work",
        smallest: np.ndarray | None,
        soft: "_SoftMap | None",
    ) -> np.ndarray:
        """Repair a map with the help of the picture, at this and at smaller sizes.

        Args:
            sizes: The picture, (3, H, W), the largest first.
            maps: The map, (H, W), alone. Both lists are emptied, so that nothing is held longer than needed.
            span: Of the whole map.
            work: Is told of what is done.
            smallest: The repaired map at the smallest of the sizes, where it is known.
            soft: The map as it was given, where many of its steps were ramps.
        """
        image, disparity, number = sizes.pop(0), maps.pop(), len(sizes)
        height, width = disparity.shape
        too_large = max(height, width) > _NETWORK_SIDE
        repaired = None if sizes else smallest
        if sizes:
            small = _half_map(disparity)
            below = soft.half() if soft is not None and too_large else None
            repaired_small = self._repair(sizes, [small], span, work, smallest, below)
            change = repaired_small - small
            del small
            disparity = _with_moved(disparity, repaired_small, change, STEP * span)
            del repaired_small, change
            if too_large:
                aligned = align_steps(image.transpose(1, 2, 0), disparity, STEP * span)
                work.report(number, 1)
                return aligned
        if repaired is None:
            repaired, _ = self._look(image, disparity, span, work, number)
        if number == work.last_look and work.is_large:
            self._give_back()
        colors = image.transpose(1, 2, 0)
        if soft is not None:
            repaired = soft.settle(colors, repaired, span)
        return restore_lost_lines(colors, repaired, STEP * span)

    def _look(
        self, image: np.ndarray, disparity: np.ndarray, span: float, work: "_Work", number: int
    ) -> tuple[np.ndarray, np.ndarray]:
        """Let the network look wherever there are steps.

        Args:
            image: (3, H, W).
            disparity: (H, W).
            span: Of the whole map.
            work: Is told which share is done.
            number: Of the sizes below this one.

        Returns:
            The repaired map, (H, W), and the votes, (4,).
        """
        height, width = disparity.shape
        disparity = pad_to_multiple(disparity, BLOCK)
        result, votes = disparity.copy(), np.zeros(4)
        tiles = [*repair_tiles(_step_sizes(disparity) > STEP * span, TILE)]
        for done, tile in enumerate(tiles):
            work.report(number, done / len(tiles))
            rows, columns = tile
            top, left = max(0, rows.start - HALO), max(0, columns.start - HALO)
            window = (slice(top, rows.stop + HALO), slice(left, columns.stop + HALO))
            repaired, found = self._run(image[:, *window], disparity[window], span)
            votes += found[0]
            result[tile] = repaired[
                rows.start - top : rows.stop - top, columns.start - left : columns.stop - left
            ]
        work.report(number, 1)
        return np.ascontiguousarray(crop_to(result, height, width)), votes


def _half_map(disparity: np.ndarray) -> np.ndarray:
    """Map (H, W) at half its size."""
    height, width = (-(-side // 2) for side in disparity.shape)

    def make(rows: slice) -> np.ndarray:
        return downsample2(pad_to_multiple(disparity[2 * rows.start : 2 * rows.stop], 2))

    return make_in_row_blocks(make, (height, width), np.float32)


def _half_mask(mask: np.ndarray) -> np.ndarray:
    """Mask (H, W) at half its size: a pixel is in it if one of its four was."""
    return np.logical_or.reduce([pad_to_multiple(mask, 2)[y::2, x::2] for y in (0, 1) for x in (0, 1)])


def _half(image: np.ndarray) -> np.ndarray:
    """Picture (3, H, W) at half its size, without a larger copy of it."""
    height, width = (-(-side // 2) for side in image.shape[1:])

    def make(rows: slice) -> np.ndarray:
        return downsample2(pad_to_multiple(image[:, 2 * rows.start : 2 * rows.stop], 2)).transpose(1, 2, 0)

    return make_in_row_blocks(make, (height, width, 3), np.float32).transpose(2, 0, 1)


def _with_moved(
    disparity: np.ndarray, repaired_small: np.ndarray, change: np.ndarray, least: float
) -> np.ndarray:
    """Take over what moved by more than ``least`` at half the size, with steps as sharp as here.

    Args:
        disparity: (H, W).
        repaired_small: The repaired map at half the size.
        change: What the repair changed there.
        least: In the unit of the map.
    """
    found = False

    def make(rows: slice) -> np.ndarray:
        nonlocal found
        top = max(0, rows.start // 2 - 1)
        window = slice(top, -(-rows.stop // 2) + 1)
        inner = slice(rows.start - 2 * top, rows.stop - 2 * top)
        coarse, moved = (upsample2(x[window])[inner, : disparity.shape[1]] for x in (repaired_small, change))
        here = np.abs(moved) > least
        found = found or bool(here.any())
        return np.where(here, coarse, disparity[rows])

    joined = make_in_row_blocks(make, disparity.shape, np.float32)
    # What moved comes from the smaller map, and is as soft as that.
    return repair_soft_edges(joined) if found else joined
