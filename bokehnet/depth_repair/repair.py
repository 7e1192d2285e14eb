"""Disparity repair without torch: the edges of an imperfect map moved to where the picture has them."""

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
    count_misplaced,
    misplaced_shares,
    step_sizes,
    take_misplaced,
)
from bokehnet.depth_repair.edge_bias import find_edge_bias, shift_edges, stands_right
from bokehnet.depth_repair.edge_profile import (
    EdgeProfile,
    accepted_offset,
    accepted_shift,
    edge_profile,
    find_depth_edges,
)
from bokehnet.depth_repair.map_offset import find_map_offset, move_map
from bokehnet.depth_repair.network_tiles import BLOCK, HALO, TILE, repair_tiles
from bokehnet.depth_repair.repair_plan import RepairPlan
from bokehnet.depth_repair.stages.denoising import is_noisy, noise_level, without_noise
from bokehnet.depth_repair.stages.edge_alignment import align_steps
from bokehnet.depth_repair.stages.edge_sharpening import (
    SHARPENED,
    SOFT,
    STEP,
    extremes,
    repair_soft_edges,
    soft_edge_fraction,
)
from bokehnet.depth_repair.stages.edge_snapping import SoftMap
from bokehnet.depth_repair.stages.overshoots import without_overshoots
from bokehnet.depth_repair.stages.thin_structures import restore_lost_lines
from bokehnet.depth_repair.stages.weighted_median import soft_steps
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

# Bytes that the network takes for a pixel that it sees at once.
_NETWORK_BYTES = 480

# Pictures with longer sides are repaired at half their size first: their maps are off by more pixels.
_LARGEST_SIDE = 1024

# Longest side of the sizes at which the network looks. What it found there is enlarged and put to the edges
# of the larger picture, which on path-traced scenes of four times the size places more pixels right than
# the network does (docs/method/large.md).
_NETWORK_SIDE = 2048

# What the network costs for a pixel, over what it costs to put a step there to the picture's edge.
_COSTLY = 10

# How many times as much must ask to move where the map is shifted as where it is not, for a place to be left
# out of a shift: on soft maps of thin things both shares are large.
_BETTER = 2

# How often at most a map is moved as a whole.
_MOVES = 3

# Share of the picture from which on it is repaired as a whole, as far as words go.
_WHOLE = 0.995

# Share of soft steps from which on those are put where the picture's colours part. Hard maps of hair have up
# to 0.17.
_RAMPS = 0.2


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


class _Placement(NamedTuple):
    """How a map is to be moved, at the smallest of the sizes at which it is repaired.

    Attributes:
        offset: Pixels down and to the right.
        shift: Pixels by which near things should grow then.
        where: The blocks in which they should, (H / 8, W / 8) bool; ``None`` for all.
        repaired: The repaired map, unless near things grow in some blocks alone.
    """

    offset: tuple[int, int] = (0, 0)
    shift: int = 0
    where: np.ndarray | None = None
    repaired: np.ndarray | None = None


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

        Noise is taken out first (:mod:`bokehnet.depth_repair.stages.denoising`). Every value stays within
        those nearby, so that flat regions remain as they are; where a soft map lacks what blur has hidden
        (:mod:`bokehnet.depth_repair.stages.deblurring`), within those of the map. Maps of large pictures are
        repaired at half the size first. Memory beyond input and output is that of a tile and a third of the
        picture.

        Args:
            image: All-in-focus picture, scene-linear, (H, W, 3).
            disparity: (H, W), any unit and offset, rising towards the camera; a defocus map will do.
            mode: "on"; "auto" leaves the map as it is, but for noise, wherever nearly all steps around stand
                right already (:func:`bokehnet.depth_repair.acceptance.take_misplaced`); "off" does so
                everywhere.
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
        if image.min() < 0:
            image = np.maximum(image, 0)
        noise = noise_level(disparity) if plan is None else plan.noise
        if not is_noisy(noise):
            return self._move_edges(image, disparity, mode, progress, plan)
        quiet = without_noise(image, disparity, noise * span)
        found = self._move_edges(image, quiet, mode, progress, plan)
        return replace(
            found,
            reason=f"{found.reason}; noise of {100 * noise:.2g} % of its range taken out",
            plan=None if found.plan is None else replace(found.plan, noise=noise),
        )

    def _move_edges(
        self,
        image: np.ndarray,
        disparity: np.ndarray,
        mode: RepairMode,
        progress: Progress | None,
        plan: RepairPlan | None,
    ) -> RepairedMap:
        """Repair a map without noise, other than "off"; see :meth:`repair`."""
        span = float(disparity.max()) - float(disparity.min())
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
        sizes = [image.transpose(2, 0, 1)]
        while max(sizes[-1].shape) > _LARGEST_SIDE:
            sizes.append(half_image(sizes[-1]))
        work = _Work([x.shape for x in sizes], progress)
        halvings, smallest = len(sizes) - 1, sizes[-1]
        if plan is None:
            small = _halved(start, halvings)
            placement, times = self._place(smallest, small, span, work), 2**halvings
            shift, offset = (
                times * placement.shift,
                (times * placement.offset[0], times * placement.offset[1]),
            )
        else:
            placement, shift, offset = _Placement(), plan.shift, plan.offset
        start, given = (move_map(x, offset) for x in (start, given))
        maps = [_shifted_where(start, shift, placement.where)]
        del start
        soft = None
        if softness > _RAMPS:
            versions = [given] if shift == 0 else [given, _shifted_where(given, shift, placement.where)]
            soft = SoftMap(tuple((soft_steps(x), x) for x in versions))
        repaired = self._repair(sizes, maps, span, work, placement.repaired, soft, ramps=softness > SOFT)
        if mode == "on":
            reason = "asked for" if plan is None else "as most of the shot"
            found = RepairPlan(repaired=True, softness=softness, shift=shift, offset=offset)
            return RepairedMap(disparity=repaired, repaired=True, reason=reason, plan=found)
        is_confirmed = True
        # The edges of a soft map have no place of their own.
        if (shift, offset) == (0, (0, 0)) and softness <= SOFT:
            before, after = _profiles_of_change(smallest, small, _halved(repaired, halvings), STEP * span)
            if before.is_centred and not after.exceeds(before):
                reason = "its edges lie at those of the picture"
                found = RepairPlan(repaired=False, softness=softness, shift=0)
                return RepairedMap(disparity=disparity.copy(), repaired=False, reason=reason, plan=found)
            is_confirmed = before.is_certain
        taken = take_misplaced(disparity, repaired, is_confirmed=is_confirmed)
        reason = f"{100 * taken.misplaced:.2g} % of its edges stood out of place"
        if offset != (0, 0):
            reason += f", all moved {_in_words(offset)}"
        if taken.part == 0:
            reason = f"only {reason}"
        elif taken.part < _WHOLE:
            reason = f"{100 * taken.part:.0f} % of the picture, as {reason}"
        found = RepairPlan(repaired=taken.part > 0, softness=softness, shift=shift, offset=offset)
        return RepairedMap(disparity=taken.disparity, repaired=taken.part > 0, reason=reason, plan=found)

    def _place(
        self, image: np.ndarray, disparity: np.ndarray, span: float, work: "_Work", moves: int = _MOVES
    ) -> _Placement:
        """How a map is to be moved, and by how many pixels near things should grow, and where.

        Args:
            image: The smallest of the sizes, (3, H, W).
            disparity: (H, W).
            span: Of the whole map.
            work: Is told what is done.
            moves: How often at most the map may be moved as a whole: where it lies beside its picture, how
                large near things should be is seen the better the nearer it comes.
        """
        repaired, found = self._look(image, disparity, span, work, 0)
        padded = pad_to_multiple(disparity, BLOCK)
        busy = step_sizes(padded) > STEP * span

        def votes(window: tuple[slice, slice], moved: np.ndarray) -> np.ndarray:
            found: np.ndarray = self._run(image[:, *window], moved, span)[1][0]
            return found

        shift = 0 if stands_right(found) else find_edge_bias(padded, busy, votes)
        edges = find_depth_edges(disparity)
        if moves > 0:
            offset = accepted_offset(image, edges, find_map_offset(padded, shift, busy, votes))
            if offset != (0, 0):
                moved = self._place(image, move_map(disparity, offset), span, work, moves - 1)
                return moved._replace(offset=(offset[0] + moved.offset[0], offset[1] + moved.offset[1]))
        placement = _Placement(repaired=repaired)
        if shift == 0:
            return placement
        # A shift by fewer pixels, if the edge profile supports no more.
        for _ in range(2):
            shifted = self._shift(image, disparity, span, work, repaired, shift)
            proposed, where = shift, shifted.where
            shift = accepted_shift(
                edge_profile(image, edges if where is None else edges.within(where)), proposed
            )
            if shift in {0, proposed}:
                break
        return placement if shift == 0 else shifted

    def _shift(
        self,
        image: np.ndarray,
        disparity: np.ndarray,
        span: float,
        work: "_Work",
        repaired: np.ndarray,
        shift: int,
    ) -> _Placement:
        """Return the placement with a shift, in the blocks where it leaves fewer edges out of place.

        Args:
            image: (3, H, W).
            disparity: (H, W).
            span: Of the whole map.
            work: Receives the progress.
            repaired: The map repaired without the shift.
            shift: Pixels by which near things grow.
        """
        shifted = shift_edges(disparity, shift)
        repaired_shifted, _ = self._look(image, shifted, span, work, 0)
        stay, move = (
            misplaced_shares(*count_misplaced(*maps, STEP * span))
            for maps in ((disparity, repaired), (shifted, repaired_shifted))
        )
        where = move < _BETTER * stay
        if where.all():
            return _Placement(shift=shift, repaired=repaired_shifted)
        return _Placement(shift=shift, where=where)

    def _run(self, image: np.ndarray, disparity: np.ndarray, span: float) -> tuple[np.ndarray, np.ndarray]:
        """Repaired disparity (H, W) of a part whose sides are multiples of a block, and votes (1, 4)."""
        # The picture may end within the last block of the map.
        fed = pad_to_multiple(image[None], BLOCK), disparity[None, None]
        repaired, votes = self._network(*fed, np.full((1, 1, 1, 1), span, np.float32))
        return repaired[0, 0], votes

    def _give_back(self) -> None:
        """Return the memory of the network's layers to the system, where the process does not keep it."""
        if keeps_freed_memory():
            return
        block = np.zeros((1, 3, BLOCK, BLOCK), np.float32)
        self._network(block, block[:, :1], np.ones((1, 1, 1, 1), np.float32), release=True)
        release_freed_memory()

    def _repair(
        self,
        sizes: list[np.ndarray],
        maps: list[np.ndarray],
        span: float,
        work: "_Work",
        smallest: np.ndarray | None,
        soft: SoftMap | None,
        *,
        ramps: bool,
    ) -> np.ndarray:
        """Repair a map with the help of the picture, at this and at smaller sizes.

        Args:
            sizes: The picture, (3, H, W), the largest first.
            maps: The map, (H, W), alone. Both lists are emptied, so that nothing is held longer than needed.
            span: Of the whole map.
            work: Is told of what is done.
            smallest: The repaired map at the smallest of the sizes, where it is known.
            soft: The map as it was given, where many of its steps were ramps.
            ramps: Whether wide ones may be left all over the map.
        """
        image, disparity, number = sizes.pop(0), maps.pop(), len(sizes)
        height, width = disparity.shape
        too_large = max(height, width) > _NETWORK_SIDE
        repaired = None if sizes else smallest
        if sizes:
            small = half_map(disparity)
            below = soft.half() if soft is not None and too_large else None
            repaired_small = self._repair(sizes, [small], span, work, smallest, below, ramps=ramps)
            change = repaired_small - small
            del small
            disparity = _with_moved(disparity, repaired_small, change, STEP * span, everywhere=ramps)
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
        return restore_lost_lines(colors, repaired, STEP * span, spread=soft is None)

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
        tiles = [*repair_tiles(step_sizes(disparity) > STEP * span, TILE)]
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


def _in_words(offset: tuple[int, int]) -> str:
    """Pixels down and to the right in words."""
    down, right = offset
    along = f"{abs(right)} px to the {'right' if right > 0 else 'left'}" if right else ""
    across = f"{abs(down)} px {'down' if down > 0 else 'up'}" if down else ""
    return " and ".join(filter(None, (along, across)))


def _profiles_of_change(
    image: np.ndarray, disparity: np.ndarray, repaired: np.ndarray, least: float
) -> tuple[EdgeProfile, EdgeProfile]:
    """Return the edge profiles of a map and of its repair, in the blocks that the repair changes.

    Args:
        image: (3, H, W).
        disparity: (H, W).
        repaired: (H, W).
        least: What makes a step, in the unit of the map.
    """
    changed = extremes(count_misplaced(disparity, repaired, least)[1] > 0, 1)[1]
    before, after = (edge_profile(image, find_depth_edges(x).within(changed)) for x in (disparity, repaired))
    return before, after


def _halved(disparity: np.ndarray, times: int) -> np.ndarray:
    """Return the map (H, W) at half its size, so many times."""
    for _ in range(times):
        disparity = half_map(disparity)
    return disparity


def _shifted_where(disparity: np.ndarray, shift: int, where: np.ndarray | None) -> np.ndarray:
    """The map (H, W) with near things grown by so many pixels where asked, in equal blocks, or all over."""
    shifted = shift_edges(disparity, shift)
    if shift == 0 or where is None:
        return shifted
    rows, columns = (
        np.arange(side) * blocks // side for side, blocks in zip(disparity.shape, where.shape, strict=True)
    )
    return np.where(where[rows[:, None], columns], shifted, disparity)


def _with_moved(
    disparity: np.ndarray, repaired_small: np.ndarray, change: np.ndarray, least: float, *, everywhere: bool
) -> np.ndarray:
    """Take over what moved by more than ``least`` at half the size, with steps as sharp as here.

    Args:
        disparity: (H, W).
        repaired_small: The repaired map at half the size.
        change: What the repair changed there.
        least: In the unit of the map.
        everywhere: Whether steps are made sharp where nothing moved as well. It spoils thin things at exact
            places before others.
    """
    moved_at = np.zeros(disparity.shape, np.bool_)

    def make(rows: slice) -> np.ndarray:
        top = max(0, rows.start // 2 - 1)
        window = slice(top, -(-rows.stop // 2) + 1)
        inner = slice(rows.start - 2 * top, rows.stop - 2 * top)
        coarse, moved = (upsample2(x[window])[inner, : disparity.shape[1]] for x in (repaired_small, change))
        moved_at[rows] = np.abs(moved) > least
        return np.where(moved_at[rows], coarse, disparity[rows])

    joined = make_in_row_blocks(make, disparity.shape, np.float32)
    if not moved_at.any():
        return joined
    # What moved comes from the smaller map, and is as soft as that.
    sharp = repair_soft_edges(joined)
    if not everywhere:
        np.copyto(sharp, joined, where=~extremes(moved_at, SHARPENED)[1])
    return sharp
