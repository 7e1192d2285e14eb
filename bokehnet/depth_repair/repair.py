"""Disparity repair: move the depth edges of an imperfect map to the edges of its picture.

Order of the stages; each is documented in its own module with its published method:

1. noise estimate and bilateral filter (``stages/denoising.py``);
2. for soft maps: removal of overshoots and shock filter (``stages/overshoots.py``, ``edge_sharpening.py``);
3. at the smallest size of an image pyramid: translation and edge bias of the whole map, by votes of the
   network that the edge profile confirms (``map_offset.py``, ``edge_bias.py``, ``edge_profile.py``);
4. from the smallest size upwards: the repair network in tiles (``network_tiles.py``), above 2048 pixels the
   two-class colour test (``stages/edge_alignment.py``);
5. for soft maps: deconvolution and weighted median (``stages/edge_snapping.py``);
6. thin structures (``stages/thin_structures.py``);
7. with "auto": acceptance in each window (``acceptance.py``).

In: all-in-focus picture, scene-linear float32 (H, W, 3), and disparity (H, W) in any unit, rising towards the
camera. Out: a :class:`RepairedMap` in the same unit. ONNX Runtime runs the network; torch is not needed.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal, NamedTuple, get_args

import numpy as np
import numpy.typing as npt

from bokehnet.arrays.halving import half_image, half_map
from bokehnet.arrays.pyramid import crop_to, pad_to_multiple, upsample2
from bokehnet.arrays.row_blocks import make_in_row_blocks
from bokehnet.checks import check_choice, check_image, check_map, check_same_size
from bokehnet.depth_repair.acceptance import (
    accept_repair,
    block_ranges,
    count_misplaced,
    misplaced_fractions,
)
from bokehnet.depth_repair.edge_bias import find_edge_bias, is_unbiased, shift_edges
from bokehnet.depth_repair.edge_profile import (
    EdgeProfile,
    accepted_offset,
    accepted_shift,
    edge_profile,
    find_depth_edges,
)
from bokehnet.depth_repair.map_offset import find_map_offset, translate_map
from bokehnet.depth_repair.network_tiles import BLOCK_PX, HALO_PX, MAX_TILE_PIXELS, repair_tiles
from bokehnet.depth_repair.repair_plan import RepairPlan
from bokehnet.depth_repair.stages.denoising import denoise_map, is_noisy, noise_level
from bokehnet.depth_repair.stages.edge_alignment import align_edges
from bokehnet.depth_repair.stages.edge_sharpening import (
    MIN_EDGE_HEIGHT,
    SHARPENING_HALO_PX,
    SOFT_FRACTION,
    local_extremes,
    repair_soft_edges,
    soft_edge_fraction,
)
from bokehnet.depth_repair.stages.edge_snapping import SoftMap
from bokehnet.depth_repair.stages.overshoots import remove_overshoots
from bokehnet.depth_repair.stages.thin_structures import restore_thin_structures
from bokehnet.depth_repair.stages.weighted_median import blurred_edge_mask
from bokehnet.inference.process_memory import keeps_freed_memory, release_freed_memory
from bokehnet.inference.session import WEIGHTS, load_network
from bokehnet.progress import Progress

__all__ = [
    "REPAIR_MODES",
    "DisparityRepair",
    "RepairMode",
    "RepairedMap",
    "network_memory",
]

RepairMode = Literal["auto", "on", "off"]
REPAIR_MODES = get_args(RepairMode)

# Memory of the network per pixel of a tile, bytes.
_NETWORK_BYTES_PER_PIXEL = 480

# Maximum side of the smallest size of the pyramid, pixels. Larger pictures are repaired at half their size
# first, because their maps are wrong by more pixels.
_BASE_SIDE_PX = 1024

# Maximum side of a size at which the network runs, pixels. Its result is enlarged and aligned with the edges
# of the larger picture, which on path-traced scenes of four times the size places more pixels correctly than
# the network does (docs/method/large.md).
_NETWORK_SIDE_PX = 2048

# Cost of the network per pixel, relative to the cost of edge alignment; for the progress only.
_NETWORK_COST = 10

# Ratio of the misplaced fractions with and without a shift from which on a block is not shifted. On soft maps
# of thin structures both fractions are large.
_MAX_MISPLACED_RATIO = 2

# Maximum number of translations of a map, one after the other.
_MAX_TRANSLATIONS = 3

# Repaired fraction of the picture above which the reason names no percentage.
_WHOLE_FRACTION = 0.995

# Fraction of soft edges above which they are snapped to colour edges. Sharp maps of hair have up to 0.17.
_MIN_SOFTNESS_TO_SNAP = 0.2


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class RepairedMap:
    """Result of the repair of one map.

    Attributes:
        disparity: Repaired map, (H, W), in the unit of the input; never the same array.
        repaired: True if edges were moved.
        reason: Reason for or against the repair in a few words.
        plan: Decisions of the repair; None if the map was not analysed.
    """

    disparity: npt.NDArray[np.float32]
    repaired: bool
    reason: str
    plan: RepairPlan | None = None


def network_memory(height: int, width: int) -> int:
    """Return the peak memory of the repair network, bytes.

    Args:
        height: Height of the picture, pixels.
        width: Width of the picture, pixels.
    """
    return _NETWORK_BYTES_PER_PIXEL * min(height * width, MAX_TILE_PIXELS)


class _Placement(NamedTuple):
    """Translation and edge bias of a map at the smallest size of the pyramid.

    Attributes:
        offset: Translation of the map down and to the right, pixels.
        shift: Pixels by which foreground regions grow after the translation, negative to shrink.
        shifted_blocks: Blocks of 8x8 pixels in which they grow, (H / 8, W / 8) bool; ``None`` for all.
        repaired: Repaired map, (H, W); ``None`` if foreground regions grow in some blocks only.
    """

    offset: tuple[int, int] = (0, 0)
    shift: int = 0
    shifted_blocks: np.ndarray | None = None
    repaired: np.ndarray | None = None


class _Workload:
    """Progress of the repair, weighted by the cost of each size of the pyramid.

    Args:
        shapes: Shapes of the picture at each size, (3, H, W), the largest first.
        progress: Progress callback; None for none.

    Attributes:
        network_sizes_below: Number of sizes smaller than the largest one at which the network runs.
        is_large: True if there are several sizes.
    """

    def __init__(self, shapes: Sequence[tuple[int, ...]], progress: Progress | None) -> None:
        smallest = len(shapes) - 1
        runs_network = [max(shape) <= _NETWORK_SIDE_PX or at == smallest for at, shape in enumerate(shapes)]
        self.network_sizes_below, self.is_large = smallest - runs_network.index(True), smallest > 0
        self._costs = [
            height * width * (_NETWORK_COST if is_network_size else 1)
            for is_network_size, (_, height, width) in zip(runs_network, shapes, strict=True)
        ]
        self._progress = progress

    def report(self, smaller_sizes: int, fraction: float) -> None:
        """Report that a fraction of one size is done.

        Args:
            smaller_sizes: Number of smaller sizes, all of which are done.
            fraction: Fraction of this size that is done, 0 to 1.
        """
        if self._progress is not None:
            at = len(self._costs) - 1 - smaller_sizes
            done = sum(self._costs[at + 1 :]) + fraction * self._costs[at]
            self._progress(round(1000 * done / sum(self._costs)), 1000)


class DisparityRepair:
    """Repair of disparity maps on the CPU.

    Args:
        weights: Folder with the network and its manifest; default: the weights of the package.
        threads: Number of threads of the network; 0 uses all cores.

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
        """Return the repaired map, (H, W); see :meth:`repair`."""
        return self.repair(image, disparity, mode).disparity

    def repair(
        self,
        image: npt.NDArray[np.floating],
        disparity: npt.NDArray[np.floating],
        mode: RepairMode = "on",
        progress: Progress | None = None,
        plan: RepairPlan | None = None,
    ) -> RepairedMap:
        """Move the depth edges of a map to the edges of the picture, and report whether and why.

        Noise is removed first (:mod:`bokehnet.depth_repair.stages.denoising`). Every output value lies within
        the range of nearby input values, so that flat regions do not change. The exception is detail that
        blur has removed from a soft map (:mod:`bokehnet.depth_repair.stages.deblurring`); it lies within the
        range of the whole map. Maps of large pictures are repaired at half the size first. The memory beyond
        input and output is that of a tile and a third of the picture.

        Args:
            image: All-in-focus picture, scene-linear, (H, W, 3).
            disparity: Map, (H, W), any unit and offset, rising towards the camera, such as a defocus map.
            mode: "on" repairs everywhere. "auto" only removes noise wherever nearly all edges are already
                accurate (:func:`bokehnet.depth_repair.acceptance.accept_repair`). "off" changes nothing.
            progress: Callback with (steps done, total steps); an exception from it ends the repair.
            plan: Decisions for the whole shot, which "auto" follows. Default: decide from this map.

        Raises:
            ShapeError: The shapes are not (H, W, 3) and (H, W) of one size.
            ParameterError: An input contains NaN or infinity, or the mode is unknown.
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
        if image.min() < 0:
            image = np.maximum(image, 0)
        noise = plan.noise if plan is not None and plan.noise is not None else noise_level(disparity)
        if not is_noisy(noise):
            return self._move_edges(image, disparity, mode, progress, plan)
        denoised = denoise_map(image, disparity, noise * span)
        outcome = self._move_edges(image, denoised, mode, progress, plan)
        return replace(
            outcome,
            reason=f"{outcome.reason}; noise of {100 * noise:.2g} % of its range taken out",
            plan=None if outcome.plan is None else replace(outcome.plan, noise=noise),
        )

    def _move_edges(
        self,
        image: np.ndarray,
        disparity: np.ndarray,
        mode: RepairMode,
        progress: Progress | None,
        plan: RepairPlan | None,
    ) -> RepairedMap:
        """Repair a map without noise in the mode "on" or "auto"; see :meth:`repair`."""
        span = float(disparity.max()) - float(disparity.min())
        if plan is not None and mode == "auto":
            if not plan.repaired:
                reason = "as most of the shot"
                return RepairedMap(disparity=disparity.copy(), repaired=False, reason=reason, plan=plan)
            mode = "on"
        softness = soft_edge_fraction(disparity) if plan is None else plan.softness
        start = clean = disparity
        if softness > SOFT_FRACTION:
            clean = remove_overshoots(disparity)
            start = repair_soft_edges(clean)
        sizes = [image.transpose(2, 0, 1)]
        while max(sizes[-1].shape) > _BASE_SIDE_PX:
            sizes.append(half_image(sizes[-1]))
        workload = _Workload([x.shape for x in sizes], progress)
        halvings, smallest = len(sizes) - 1, sizes[-1]
        if plan is None:
            small_map = _halved_repeatedly(start, halvings)
            placement, scale = self._estimate_placement(smallest, small_map, span, workload), 2**halvings
            shift, offset = (
                scale * placement.shift,
                (scale * placement.offset[0], scale * placement.offset[1]),
            )
        else:
            placement, shift, offset = _Placement(), plan.shift, plan.offset
        start, clean = (translate_map(x, offset) for x in (start, clean))
        maps = [_shift_blocks(start, shift, placement.shifted_blocks)]
        del start
        soft = None
        if softness > _MIN_SOFTNESS_TO_SNAP:
            variants = (
                [clean] if shift == 0 else [clean, _shift_blocks(clean, shift, placement.shifted_blocks)]
            )
            soft = SoftMap(tuple((blurred_edge_mask(x), x) for x in variants))
        repaired = self._repair(
            sizes, maps, span, workload, placement.repaired, soft, ramps=softness > SOFT_FRACTION
        )
        if mode == "on":
            reason = "asked for" if plan is None else "as most of the shot"
            decisions = RepairPlan(repaired=True, softness=softness, shift=shift, offset=offset)
            return RepairedMap(disparity=repaired, repaired=True, reason=reason, plan=decisions)
        is_confirmed = True
        # The edges of a soft map have no definite position.
        if (shift, offset) == (0, (0, 0)) and softness <= SOFT_FRACTION:
            before, after = _profiles_of_change(
                smallest, small_map, _halved_repeatedly(repaired, halvings), MIN_EDGE_HEIGHT * span
            )
            if before.is_centred and not after.exceeds(before):
                reason = "its edges lie at those of the picture"
                decisions = RepairPlan(repaired=False, softness=softness, shift=0)
                return RepairedMap(disparity=disparity.copy(), repaired=False, reason=reason, plan=decisions)
            is_confirmed = before.is_certain
        accepted = accept_repair(disparity, repaired, is_confirmed=is_confirmed)
        reason = f"{100 * accepted.misplaced_fraction:.2g} % of its edges stood out of place"
        if offset != (0, 0):
            reason += f", all moved {_in_words(offset)}"
        if accepted.repaired_fraction == 0:
            reason = f"only {reason}"
        elif accepted.repaired_fraction < _WHOLE_FRACTION:
            reason = f"{100 * accepted.repaired_fraction:.0f} % of the picture, as {reason}"
        decisions = RepairPlan(
            repaired=accepted.repaired_fraction > 0, softness=softness, shift=shift, offset=offset
        )
        return RepairedMap(
            disparity=accepted.disparity,
            repaired=accepted.repaired_fraction > 0,
            reason=reason,
            plan=decisions,
        )

    def _estimate_placement(
        self,
        image: np.ndarray,
        disparity: np.ndarray,
        span: float,
        workload: "_Workload",
        max_translations: int = _MAX_TRANSLATIONS,
    ) -> _Placement:
        """Estimate translation and edge bias of a map, and repair it with them.

        Args:
            image: Picture at the smallest size of the pyramid, scene-linear, (3, H, W).
            disparity: Map of the same size, (H, W), any unit.
            span: Range of the whole map, in its unit.
            workload: Receiver of the progress.
            max_translations: Maximum number of translations. The estimate of the edge bias improves as the
                map approaches the correct translation.
        """
        repaired, total_votes = self._run_tiles(image, disparity, span, workload, 0)
        padded = pad_to_multiple(disparity, BLOCK_PX)
        busy = block_ranges(padded) > MIN_EDGE_HEIGHT * span

        def votes(window: tuple[slice, slice], moved: np.ndarray) -> np.ndarray:
            window_votes: np.ndarray = self._run_network(image[:, *window], moved, span)[1][0]
            return window_votes

        shift = 0 if is_unbiased(total_votes) else find_edge_bias(padded, busy, votes)
        edges = find_depth_edges(disparity)
        if max_translations > 0:
            offset = accepted_offset(image, edges, find_map_offset(padded, shift, busy, votes))
            if offset != (0, 0):
                moved = self._estimate_placement(
                    image, translate_map(disparity, offset), span, workload, max_translations - 1
                )
                return moved._replace(offset=(offset[0] + moved.offset[0], offset[1] + moved.offset[1]))
        placement = _Placement(repaired=repaired)
        if shift == 0:
            return placement
        # If the edge profile supports only a part of the shift, try that part.
        for _ in range(2):
            shifted = self._shift(image, disparity, span, workload, repaired, shift)
            proposed, shifted_blocks = shift, shifted.shifted_blocks
            shift = accepted_shift(
                edge_profile(image, edges if shifted_blocks is None else edges.within(shifted_blocks)),
                proposed,
            )
            if shift in {0, proposed}:
                break
        return placement if shift == 0 else shifted

    def _shift(
        self,
        image: np.ndarray,
        disparity: np.ndarray,
        span: float,
        workload: "_Workload",
        repaired: np.ndarray,
        shift: int,
    ) -> _Placement:
        """Return the placement with a shift, in the blocks where it leaves fewer edges out of place.

        Args:
            image: Picture, scene-linear, (3, H, W).
            disparity: Map of the same size, (H, W), any unit.
            span: Range of the whole map, in its unit.
            workload: Receiver of the progress.
            repaired: Map repaired without the shift, (H, W).
            shift: Pixels by which foreground regions grow, negative to shrink.
        """
        shifted = shift_edges(disparity, shift)
        repaired_shifted, _ = self._run_tiles(image, shifted, span, workload, 0)
        misplaced_unshifted, misplaced_shifted = (
            misplaced_fractions(*count_misplaced(*maps, MIN_EDGE_HEIGHT * span))
            for maps in ((disparity, repaired), (shifted, repaired_shifted))
        )
        shifted_blocks = misplaced_shifted < _MAX_MISPLACED_RATIO * misplaced_unshifted
        if shifted_blocks.all():
            return _Placement(shift=shift, repaired=repaired_shifted)
        return _Placement(shift=shift, shifted_blocks=shifted_blocks)

    def _run_network(
        self, image: np.ndarray, disparity: np.ndarray, span: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """Run the network on a window; return the repaired disparity (H, W) and the votes (1, 4).

        Args:
            image: Picture, scene-linear, (3, H, W) or up to a block less.
            disparity: Map with sides that are multiples of 8, (H, W).
            span: Range of the whole map, in its unit.
        """
        # The picture may end inside the last block of the map.
        inputs = pad_to_multiple(image[None], BLOCK_PX), disparity[None, None]
        repaired, votes = self._network(*inputs, np.full((1, 1, 1, 1), span, np.float32))
        return repaired[0, 0], votes

    def _release_memory(self) -> None:
        """Return the memory of the network to the system, unless the process keeps freed memory."""
        if keeps_freed_memory():
            return
        block = np.zeros((1, 3, BLOCK_PX, BLOCK_PX), np.float32)
        self._network(block, block[:, :1], np.ones((1, 1, 1, 1), np.float32), release=True)
        release_freed_memory()

    def _repair(
        self,
        sizes: list[np.ndarray],
        maps: list[np.ndarray],
        span: float,
        workload: "_Workload",
        smallest: np.ndarray | None,
        soft: SoftMap | None,
        *,
        ramps: bool,
    ) -> np.ndarray:
        """Repair a map at this and, recursively, at all smaller sizes of the pyramid.

        Args:
            sizes: Pyramid of the picture, (3, H, W) each, the largest first.
            maps: List of one map, (H, W). The function empties both lists to free memory early.
            span: Range of the whole map, in its unit.
            workload: Receiver of the progress.
            smallest: Repaired map at the smallest size, (H, W); None if unknown.
            soft: Input map with soft edges; None for sharp maps.
            ramps: True if wide ramps may remain anywhere in the map.
        """
        image, disparity, sizes_below = sizes.pop(0), maps.pop(), len(sizes)
        height, width = disparity.shape
        exceeds_network_size = max(height, width) > _NETWORK_SIDE_PX
        repaired = None if sizes else smallest
        if sizes:
            small_map = half_map(disparity)
            half_soft = soft.half() if soft is not None and exceeds_network_size else None
            repaired_small = self._repair(
                sizes, [small_map], span, workload, smallest, half_soft, ramps=ramps
            )
            change = repaired_small - small_map
            del small_map
            disparity = _upsample_changes(
                disparity, repaired_small, change, MIN_EDGE_HEIGHT * span, sharpen_all=ramps
            )
            del repaired_small, change
            if exceeds_network_size:
                aligned = align_edges(image.transpose(1, 2, 0), disparity, MIN_EDGE_HEIGHT * span)
                workload.report(sizes_below, 1)
                return aligned
        if repaired is None:
            repaired, _ = self._run_tiles(image, disparity, span, workload, sizes_below)
        if sizes_below == workload.network_sizes_below and workload.is_large:
            self._release_memory()
        colors = image.transpose(1, 2, 0)
        if soft is not None:
            repaired = soft.snap(colors, repaired, span)
        return restore_thin_structures(colors, repaired, MIN_EDGE_HEIGHT * span, spread=soft is None)

    def _run_tiles(
        self, image: np.ndarray, disparity: np.ndarray, span: float, workload: "_Workload", sizes_below: int
    ) -> tuple[np.ndarray, np.ndarray]:
        """Run the network in all tiles that contain depth edges.

        Args:
            image: Picture, scene-linear, (3, H, W).
            disparity: Map, (H, W), any unit.
            span: Range of the whole map, in its unit.
            workload: Receiver of the progress.
            sizes_below: Number of smaller sizes in the pyramid.

        Returns:
            Repaired map, (H, W), and sum of the votes, (4,).
        """
        height, width = disparity.shape
        disparity = pad_to_multiple(disparity, BLOCK_PX)
        result, votes = disparity.copy(), np.zeros(4)
        tiles = [*repair_tiles(block_ranges(disparity) > MIN_EDGE_HEIGHT * span, MAX_TILE_PIXELS)]
        for done, tile in enumerate(tiles):
            workload.report(sizes_below, done / len(tiles))
            rows, columns = tile
            top, left = max(0, rows.start - HALO_PX), max(0, columns.start - HALO_PX)
            window = (slice(top, rows.stop + HALO_PX), slice(left, columns.stop + HALO_PX))
            repaired, tile_votes = self._run_network(image[:, *window], disparity[window], span)
            votes += tile_votes[0]
            result[tile] = repaired[
                rows.start - top : rows.stop - top, columns.start - left : columns.stop - left
            ]
        workload.report(sizes_below, 1)
        return np.ascontiguousarray(crop_to(result, height, width)), votes


def _in_words(offset: tuple[int, int]) -> str:
    """Return a translation (down, right), pixels, in words."""
    down, right = offset
    along = f"{abs(right)} px to the {'right' if right > 0 else 'left'}" if right else ""
    across = f"{abs(down)} px {'down' if down > 0 else 'up'}" if down else ""
    return " and ".join(filter(None, (along, across)))


def _profiles_of_change(
    image: np.ndarray, disparity: np.ndarray, repaired: np.ndarray, min_height: float
) -> tuple[EdgeProfile, EdgeProfile]:
    """Return the edge profiles of a map and of its repair, in the blocks that the repair changes.

    Args:
        image: Picture, scene-linear, (3, H, W).
        disparity: Map before the repair, (H, W).
        repaired: Map after the repair, (H, W).
        min_height: Minimum height of a depth edge, in the unit of the map.
    """
    changed = local_extremes(count_misplaced(disparity, repaired, min_height)[1] > 0, 1)[1]
    before, after = (edge_profile(image, find_depth_edges(x).within(changed)) for x in (disparity, repaired))
    return before, after


def _halved_repeatedly(disparity: np.ndarray, scale: int) -> np.ndarray:
    """Return the map (H, W) after halving its size some times."""
    for _ in range(scale):
        disparity = half_map(disparity)
    return disparity


def _shift_blocks(disparity: np.ndarray, shift: int, shifted_blocks: np.ndarray | None) -> np.ndarray:
    """Return the map with foreground regions grown in some blocks.

    Args:
        disparity: Map, (H, W), any unit.
        shift: Pixels by which foreground regions grow, negative to shrink.
        shifted_blocks: Blocks in which they grow, bool; they divide the map evenly. ``None`` for the whole
            map.
    """
    shifted = shift_edges(disparity, shift)
    if shift == 0 or shifted_blocks is None:
        return shifted
    rows, columns = (
        np.arange(side) * blocks // side
        for side, blocks in zip(disparity.shape, shifted_blocks.shape, strict=True)
    )
    return np.where(shifted_blocks[rows[:, None], columns], shifted, disparity)


def _upsample_changes(
    disparity: np.ndarray,
    repaired_small: np.ndarray,
    change: np.ndarray,
    min_height: float,
    *,
    sharpen_all: bool,
) -> np.ndarray:
    """Return the map with the changes of the repair at half the size, and with sharp edges there.

    Args:
        disparity: Map, (H, W).
        repaired_small: Repaired map at half the size, (H / 2, W / 2), rounded up.
        change: Change by the repair at half the size, of the same shape.
        min_height: Minimum change that is copied, in the unit of the map.
        sharpen_all: True to sharpen edges that did not move, too. This degrades accurately placed thin
            structures in front of others.
    """
    moved_at = np.zeros(disparity.shape, np.bool_)

    def make(rows: slice) -> np.ndarray:
        top = max(0, rows.start // 2 - 1)
        window = slice(top, -(-rows.stop // 2) + 1)
        inner = slice(rows.start - 2 * top, rows.stop - 2 * top)
        coarse, moved = (upsample2(x[window])[inner, : disparity.shape[1]] for x in (repaired_small, change))
        moved_at[rows] = np.abs(moved) > min_height
        return np.where(moved_at[rows], coarse, disparity[rows])

    joined = make_in_row_blocks(make, disparity.shape, np.float32)
    if not moved_at.any():
        return joined
    # Changed pixels come from the smaller map, whose edges are soft at this size.
    sharp = repair_soft_edges(joined)
    if not sharpen_all:
        np.copyto(sharp, joined, where=~local_extremes(moved_at, SHARPENING_HALO_PX)[1])
    return sharp
