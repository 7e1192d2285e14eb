"""Merged lights and the blur of their visibility, against traced rays."""

import numpy as np
import pytest

from bokehnet.baselines.spread.merged_lights import (
    merge_lights,
    printed_visibility_blur,
    splat_sources,
    visibility_blur,
)
from bokehnet.errors import ParameterError

RNG = np.random.default_rng(0)
LENS = 20.0


def edge_at(distance):
    """Blocker: the half plane x > 0 at a distance."""

    def blockers(point, pupil):
        crossing = pupil[:, 0] + (point[0] - pupil[:, 0]) * distance / point[2]
        return np.where(crossing > 0, distance, np.inf)

    return blockers


@pytest.mark.parametrize("distance", [100.0, 500.0, 1500.0])
def test_the_shadow_is_as_wide_as_derived_and_not_as_printed(distance):
    """Authority: rays from the two ends of the source over a blocker's edge to the lens."""
    source, radius = 2000.0, 3.0
    ends = []
    for x in (-radius, radius):
        # Through (0, distance) from (x, source) to the lens at 0.
        ends.append(x + (0.0 - x) * source / (source - distance))
    half = abs(ends[1] - ends[0]) / 2
    assert visibility_blur(radius, source, distance) == pytest.approx(half)
    # In pupil radii times the sprite's radius, as (5.4) is meant, with c = 1.
    printed = printed_visibility_blur(radius, source, distance, 0.5, 1.0)
    if distance != source / 2:
        assert printed != pytest.approx(half, rel=0.3)


def test_the_printed_blur_grows_as_the_blocker_comes_to_the_lens():
    """There every light has the same shadow, so that the blur must vanish."""
    assert visibility_blur(3.0, 2000.0, 1.0) < 0.01
    assert printed_visibility_blur(3.0, 2000.0, 1.0, 0.5, 1.0) > 1000
    with pytest.raises(ParameterError):
        visibility_blur(1.0, 100.0, 200.0)


def test_merging_keeps_light_and_mean():
    positions = RNG.normal(0, 1, (80, 3))
    positions[40:, 0] += 60
    lights = RNG.random((80, 3))
    sources, label = merge_lights(positions, lights, 2, seed=3)
    assert len(sources) == 2
    assert sum(source.light for source in sources) == pytest.approx(lights.sum(0))
    assert len(np.unique(label[:40])) == len(np.unique(label[40:])) == 1
    weight = lights[:40].sum(1)
    mean = (positions[:40] * weight[:, None]).sum(0) / weight.sum()
    assert sources[label[0]].position == pytest.approx(mean)


def test_an_area_source_has_the_mean_shadow_of_its_lights():
    """Authority: the discs of all lights, each with its own visibility."""
    angle, distance = RNG.random(300) * 2 * np.pi, 3.0 * np.sqrt(RNG.random(300))
    positions = np.stack([distance * np.cos(angle), distance * np.sin(angle), np.full(300, 2000.0)], -1)
    lights = np.ones((300, 3)) / 300

    def blur(position):
        return 32.0, 32.0, -24.0  # the same disc for all: only the visibility differs

    points = merge_lights(positions, lights, 300)[0]
    exact = splat_sources(points, edge_at(800.0), LENS, blur, (64, 64))
    merged = splat_sources(merge_lights(positions, lights, 1)[0], edge_at(800.0), LENS, blur, (64, 64))
    hard = merge_lights(positions, lights, 1)[0]
    unblurred = splat_sources(
        [type(hard[0])(position=hard[0].position, light=hard[0].light, radius=0.0)],
        edge_at(800.0),
        LENS,
        blur,
        (64, 64),
    )
    assert merged.sum() == pytest.approx(exact.sum(), rel=0.02)
    assert np.abs(merged - exact).sum() < 0.6 * np.abs(unblurred - exact).sum()
