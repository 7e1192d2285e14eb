"""Disparity repair: move the depth edges of an imperfect map to the edges of its picture.

Steps; each stage is documented in its own module with its published method:

1. noise is measured and removed (``stages/denoise.py``);
2. at the smallest size of an image pyramid soft edges are sharpened (``stages/sharpen.py``), and offset,
   growth and agreement with the picture are measured (``diagnosis.py``). A map whose edges do not follow the
   picture stays as it is;
3. proposals: the map is placed (``stages/register.py``), blurred detail is restored (``stages/deblur.py``),
   and so are thin structures (``stages/thin_structures.py``); maps without any thin structure are grown along
   their colours (``stages/thin_growth.py``);
4. one rule accepts the changes in each place (``acceptance.py``);
5. from the smallest size upwards, accepted changes are enlarged and aligned (``stages/enlarge.py``).

In: all-in-focus picture, scene-linear float32 (H, W, 3), and disparity (H, W) in any unit, rising towards the
camera. Out: a :class:`RepairedMap` in the same unit. All steps are in closed form; none has learned weights.
"""

from dataclasses import dataclass, replace
from typing import Literal, get_args

import numpy as np
import numpy.typing as npt

from bokehnet.arrays.halving import halvings
from bokehnet.arrays.square_windows import dilated
from bokehnet.checks import check_choice, check_image, check_map, check_same_size
from bokehnet.deprecation import warn_deprecated
from bokehnet.depth_repair.acceptance import accepted_blocks, block_pixels, changed_pixels
from bokehnet.depth_repair.config import BLOCK_PX, MAX_RESIDUAL_RATIO, MIN_EDGE_HEIGHT, RepairConfig
from bokehnet.depth_repair.diagnosis import Diagnosis, diagnose, noise_level
from bokehnet.depth_repair.filters import local_extremes
from bokehnet.depth_repair.repair_plan import RepairPlan
from bokehnet.depth_repair.stages.deblur import (
    estimate_blur,
    restore_blurred_detail,
    snap_soft_edges,
)
from bokehnet.depth_repair.stages.denoise import denoise_map, without_outliers
from bokehnet.depth_repair.stages.enlarge import enlarge_changes
from bokehnet.depth_repair.stages.register import NO_PLACEMENT, Placement
from bokehnet.depth_repair.stages.sharpen import repair_soft_edges, soft_edge_fraction, soft_mask
from bokehnet.depth_repair.stages.thin_growth import grow_thin_structures
from bokehnet.depth_repair.stages.thin_structures import restore_thin_structures
from bokehnet.progress import Progress, ignore_progress

__all__ = ["REPAIR_MODES", "DisparityRepair", "RepairMode", "RepairedMap"]

RepairMode = Literal["auto", "on", "off"]
REPAIR_MODES = get_args(RepairMode)


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class RepairedMap:
    """Result of the repair of one map.

    Attributes:
        disparity: Repaired map, (H, W), in the unit of the input; never the same array.
        repaired: True if edges were moved.
        reason: Errors of the map and their correction, or the reason against a repair, in a few words.
        plan: Decisions of the repair; None if the map was not analysed.
        diagnosis: Measured errors of the map; None if it was not analysed.
    """

    disparity: npt.NDArray[np.float32]
    repaired: bool
    reason: str
    plan: RepairPlan | None = None
    diagnosis: Diagnosis | None = None


class DisparityRepair:
    """Repair of disparity maps on the CPU.

    Args:
        weights: Without effect: folder of the network of version 0.1.
        threads: Without effect: number of threads of that network.
        config: Numbers of the repair.
    """

    def __init__(self, weights: object = None, threads: int = 0, config: RepairConfig | None = None) -> None:
        if weights is not None or threads:
            warn_deprecated("the repair has no network: version 0.3 removes weights= and threads=")
        self._config = config or RepairConfig()

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

        Noise is removed first. Every output value lies within the range of nearby input values, so that flat
        regions do not change. The exception is detail that blur has removed from a soft map
        (:mod:`bokehnet.depth_repair.stages.deblur`); it lies within the range of the whole map. The memory
        beyond input and output is at most that of the picture, and twice that where noise is removed.

        Args:
            image: All-in-focus picture, scene-linear, (H, W, 3).
            disparity: Map, (H, W), any unit and offset, rising towards the camera, such as a defocus map.
            mode: "on" moves edges everywhere, "auto" only where the picture agrees better with their new
                place (:func:`bokehnet.depth_repair.acceptance.accepted_blocks`). Thin structures grow only
                there in both modes. "off" changes nothing.
            progress: Callback with (steps done, total steps); an exception from it ends the repair.
            plan: Decisions for the whole shot, which "auto" follows: the errors of its maps. Places are
                accepted in each frame. Default: decide from this map.

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
        return self._repair(image, disparity, mode, progress or ignore_progress, plan)

    def _repair(
        self,
        image: np.ndarray,
        disparity: np.ndarray,
        mode: RepairMode,
        progress: Progress,
        plan: RepairPlan | None,
    ) -> RepairedMap:
        """Repair a map that is not constant in the mode "on" or "auto"; see :meth:`repair`."""
        config = self._config
        clean, noise, wrong_pixels = self._clean(image, disparity, plan)
        if plan is not None and mode == "auto" and not plan.repaired:
            reason = _with_cleaning("as most of the shot", noise, wrong_pixels)
            return RepairedMap(disparity=clean.copy(), repaired=False, reason=reason, plan=plan)
        softness = soft_edge_fraction(clean) if plan is None else plan.softness
        is_soft = "sharpen" in config.stages and softness > config.min_softness
        pictures, maps = halvings(image.transpose(2, 0, 1), clean, config.base_side_px)
        scale, colors, small = 2 ** (len(maps) - 1), pictures[-1], maps[-1]
        start = repair_soft_edges(small) if is_soft else small
        if plan is None:
            diagnosis = diagnose(colors, start, softness, config)
        else:
            diagnosis = _planned_diagnosis(plan, scale)
        diagnosis = replace(diagnosis, noise=noise, wrong_pixels=wrong_pixels)
        decides = mode == "auto"
        if decides and plan is None and diagnosis.certainty < config.min_certainty:
            return _result(clean, 0.0, 0.0, diagnosis, scale, "its edges do not follow the picture")
        proposal = start
        blocks = np.zeros([-(-side // BLOCK_PX) for side in start.shape], bool)
        levels = len(maps) - 1
        candidates = diagnosis.candidates if decides else (diagnosis.placement,)
        steps = len(candidates) + levels
        for number, placement in enumerate(candidates):
            progress(number, steps)
            proposed = self._propose(colors, start, small if is_soft else None, placement)
            accepted = (
                accepted_blocks(colors, proposal, proposed, config) if decides else np.ones_like(blocks)
            )
            proposal = np.where(block_pixels(accepted, start.shape), proposed, proposal)
            blocks |= accepted
        if "grow" in config.stages and diagnosis.thin_fraction == 0:
            grown = grow_thin_structures(
                colors.transpose(1, 2, 0), proposal, MIN_EDGE_HEIGHT * float(np.ptp(start))
            )
            accepted = accepted_blocks(colors, proposal, grown, config)
            proposal = np.where(block_pixels(accepted, start.shape), grown, proposal)
            blocks |= accepted
        if not is_soft and not blocks.any():
            return _result(clean, 0.0, 0.0, diagnosis, scale)
        near_edges = _edge_pixels(start)
        misplaced = changed_pixels(small, proposal)[near_edges].sum() / max(near_edges.sum(), 1)
        for level in reversed(range(levels)):
            progress(steps - level - 1, steps)
            change = proposal - maps[level + 1]
            allowed = None if is_soft else block_pixels(blocks, maps[level].shape, 2 ** (levels - level))
            proposal = enlarge_changes(
                pictures[level].transpose(1, 2, 0), maps[level], proposal, change, allowed, sharpen=is_soft
            )
        progress(steps, steps)
        reason = "as most of the shot" if plan is not None else "" if decides else "asked for"
        accepted_fraction = 1.0 if is_soft else float(blocks.mean())
        return _result(proposal, accepted_fraction, float(misplaced), diagnosis, scale, reason)

    def _clean(
        self, image: np.ndarray, disparity: np.ndarray, plan: RepairPlan | None
    ) -> tuple[np.ndarray, float, float]:
        """Return the map without noise and wrong single pixels, and how much of both was removed.

        The noise is a fraction of the range of the map, the wrong pixels are a fraction of all.
        """
        config, span = self._config, float(np.ptp(disparity))
        if "denoise" not in config.stages:
            return disparity, 0.0, 0.0
        noise = noise_level(disparity) if plan is None or plan.noise is None else plan.noise
        lowest, highest = config.noise_range
        noise = noise if lowest < noise < highest else 0.0
        clean = denoise_map(image, disparity, noise * span) if noise else disparity
        fraction = None if plan is None else plan.wrong_pixels
        clean, wrong_pixels = without_outliers(image, clean, MIN_EDGE_HEIGHT * span, fraction)
        return clean, noise, wrong_pixels

    def _propose(
        self,
        image: np.ndarray,
        start: np.ndarray,
        soft: np.ndarray | None,
        placement: Placement,
    ) -> np.ndarray:
        """Return the map that the stages propose, (H, W).

        Args:
            image: Picture at the smallest size, scene-linear, (3, H, W).
            start: Map with sharp edges, (H, W).
            soft: The same map with its soft edges; None for sharp maps.
            placement: Offset and growth of the map.
        """
        stages, span = self._config.stages, float(np.ptp(start))
        colors, repaired = image.transpose(1, 2, 0), placement.apply(start)
        if soft is not None:
            repaired = self._restore_soft_edges(colors, soft, repaired, placement, span)
        if "thin" in stages:
            without = repaired
            repaired = restore_thin_structures(colors, repaired, MIN_EDGE_HEIGHT * span)
            # Traced lines have rough borders.
            repaired = snap_soft_edges(colors, repaired, dilated(repaired != without, 1), span)
        return repaired

    def _restore_soft_edges(
        self, image: np.ndarray, soft: np.ndarray, repaired: np.ndarray, placement: Placement, span: float
    ) -> np.ndarray:
        """Return the map with blurred detail and with its soft edges at colour edges, (H, W).

        A map that was grown before it was blurred has a far smaller residual with its growth corrected. The
        input is better if only blur makes thin structures seem larger.
        """
        stages, versions = self._config.stages, []
        for growth in sorted({0, placement.growth}, key=abs):
            placed = replace(placement, growth=growth).apply(soft)
            mask = soft_mask(placed, span)
            blur, values = estimate_blur(placed, repaired, mask), repaired
            if "deblur" in stages and blur.sigma:
                values = restore_blurred_detail(image, placed, repaired, blur.sigma)
                blur = estimate_blur(placed, values, mask)
            versions.append((blur.residual, mask, values))
        first, last = versions[0], versions[-1]
        _, mask, values = last if last[0] < MAX_RESIDUAL_RATIO * first[0] else first
        return snap_soft_edges(image, values, mask, span) if "snap" in stages else values


def _edge_pixels(disparity: np.ndarray) -> np.ndarray:
    """Return the pixels within 4 pixels of a depth edge, (H, W) bool."""
    low, high = local_extremes(disparity, BLOCK_PX // 2)
    return high - low > MIN_EDGE_HEIGHT * float(np.ptp(disparity))


def _planned_diagnosis(plan: RepairPlan, scale: int) -> Diagnosis:
    """Return the diagnosis of all maps of a shot at 1 / ``scale`` of their size."""
    down, right = (round(pixels / scale) for pixels in plan.offset)
    placement = Placement(offset=(down, right), growth=round(plan.shift / scale))
    local = Placement(growth=round(plan.local_shift / scale))
    return Diagnosis(
        softness=plan.softness,
        placement=placement,
        candidates=(placement, local) if placement == NO_PLACEMENT != local else (placement,),
        thin_fraction=plan.thin_fraction,
    )


def _result(
    disparity: np.ndarray,
    accepted_fraction: float,
    misplaced: float,
    diagnosis: Diagnosis,
    scale: int,
    reason: str = "",
) -> RepairedMap:
    """Return the result with its plan and, unless given, its reason.

    Args:
        disparity: Map, (H, W).
        accepted_fraction: Fraction of the picture in which the repair was accepted, 0 to 1.
        misplaced: Fraction of the pixels near edges that changed, 0 to 1.
        diagnosis: Errors of the map at the smallest size.
        scale: Ratio of the full and the smallest size.
        reason: Reason; empty to describe errors and corrections.
    """
    placement = diagnosis.placement
    down, right = placement.offset
    plan = RepairPlan(
        repaired=accepted_fraction > 0,
        softness=diagnosis.softness,
        shift=scale * placement.growth,
        offset=(scale * down, scale * right),
        noise=diagnosis.noise,
        local_shift=scale * sum(candidate.growth for candidate in diagnosis.candidates[1:]),
        thin_fraction=diagnosis.thin_fraction,
        wrong_pixels=diagnosis.wrong_pixels,
    )
    reason = reason or _in_words(plan, accepted_fraction, misplaced)
    return RepairedMap(
        disparity=disparity.copy(),
        repaired=plan.repaired,
        reason=_with_cleaning(reason, diagnosis.noise, diagnosis.wrong_pixels),
        plan=plan,
        diagnosis=diagnosis,
    )


def _with_cleaning(reason: str, noise: float, wrong_pixels: float) -> str:
    """Return a reason with the noise and the wrong pixels that were removed; both are fractions, 0 to 1."""
    if noise:
        reason += f"; noise of {100 * noise:.2g} % of its range removed"
    if wrong_pixels:
        reason += f"; {100 * wrong_pixels:.2g} % wrong single pixels corrected"
    return reason


def _in_words(plan: RepairPlan, accepted_fraction: float, misplaced: float) -> str:
    """Return the errors of a map and their correction, as a photographer would say it."""
    down, right = plan.offset
    errors = []
    if plan.repaired:
        if plan.shift:
            width = "narrow" if plan.shift > 0 else "wide"
            errors.append(f"near things were {abs(plan.shift)} px too {width}")
        if right:
            errors.append(f"the map lay {abs(right)} px too far {'left' if right > 0 else 'right'}")
        if down:
            errors.append(f"the map lay {abs(down)} px too {'high' if down > 0 else 'low'}")
        if not errors:
            errors.append(f"{max(1, round(100 * misplaced))} % of the edges were out of place")
        percentage = f"{100 * accepted_fraction:.0f}"
        errors.append("corrected" if percentage == "100" else f"corrected in {percentage} % of it")
    else:
        errors.append("no edge is clearly out of place")
    return "; ".join(errors)
