"""Whole methods, pixel by pixel in plain Python, beside what their kernels make of the same picture.

Methods that are not here have their oracle beside their equations; ``ORACLES`` of ``test_registry.py`` says
where.
"""

import math

import numpy as np
import pytest

from bokehnet import baselines
from bokehnet.baselines.apertures import psf_image, radius_ladder
from bokehnet.baselines.gather.basic_gather import random_number
from bokehnet.baselines.gather.spiral import GOLDEN_ANGLE
from bokehnet.baselines.spread.lens_tables import defocus_ladder, traced_tables
from bokehnet.baselines.spread.lommel_spots import WAVELENGTHS, lommel_table
from bokehnet.optics.aberrations.chromatic_aberration import ChromaticAberration
from bokehnet.optics.aberrations.lens_response import LensResponse
from bokehnet.optics.aperture import Aperture
from bokehnet.optics.sampling import disc_from_square, sobol

LUMA = np.array([0.2126, 0.7152, 0.0722])


def scene(height=17, width=22):
    """A near square and what is in focus, before a far wall; one bright light."""
    rng = np.random.default_rng(7)
    image = rng.random((height, width, 3)).astype(np.float32)
    image[13, 4] = 12
    defocus = np.full((height, width), -4.6, np.float32)
    defocus[4:11, 6:13] = 5.2
    defocus[:, 17:] = 0.1
    return image, defocus


def clamp(value, low, high):
    return min(max(value, low), high)


def texel(values, y, x):
    """The pixel whose middle is nearest."""
    height, width = values.shape[:2]
    row, column = clamp(math.floor(y + 0.5), 0, height - 1), clamp(math.floor(x + 0.5), 0, width - 1)
    return values[row, column].astype(float)


def four(values, y, x):
    """The 2x2 pixels that one of half the size stands for; the border's beyond it."""
    height, width = values.shape[:2]
    rows, columns = (2 * y, min(2 * y + 1, height - 1)), (2 * x, min(2 * x + 1, width - 1))
    return [values[row, column].astype(float) for row in rows for column in columns]


def half_size(values):
    height, width = values.shape[:2]
    small = np.empty(((height + 1) // 2, (width + 1) // 2, *values.shape[2:]))
    for y, x in np.ndindex(small.shape[:2]):
        small[y, x] = sum(four(values, y, x)) / 4
    return small


def full_size(values, height, width):
    """Bilinear."""
    large = np.zeros((height, width, *values.shape[2:]))
    for y, x in np.ndindex(height, width):
        down = clamp((y + 0.5) / 2 - 0.5, 0, values.shape[0] - 1)
        across = clamp((x + 0.5) / 2 - 0.5, 0, values.shape[1] - 1)
        for row, v in ((int(down), 1 - down % 1), (int(down) + 1, down % 1)):
            for column, u in ((int(across), 1 - across % 1), (int(across) + 1, across % 1)):
                if u > 0 and v > 0:
                    large[y, x] += u * v * values[row, column]
    return large


def tile_of(values, y, x, size):
    """Values in the tiles beside that of a pixel and in its own; blur here is never wider than a tile."""
    top, left = max(y // size - 1, 0) * size, max(x // size - 1, 0) * size
    return values[top : (y // size + 2) * size, left : (x // size + 2) * size]


def rings_of(count):
    """Ring and angle of each tap, the middle first."""
    yield 0, 0.0
    for number in range(1, count + 1):
        for index in range(8 * number):
            yield number, 2 * math.pi * (index + 0.5) / (8 * number)


# Multi-pass gather.


def plane_of(image, blur, share, scale):
    """Colours and coverage of one plane of the multi-pass gather."""
    small = half_size(np.dstack([image * share[..., None], share]))
    radius = half_size(blur * share) / np.maximum(small[..., 3], 1e-6) / 2
    sums = np.zeros_like(small)
    for y, x in np.ndindex(radius.shape):
        away, angle, area = 0.0, 0.0, math.pi / 4
        while away < radius.max() + 0.5:
            down, across = y + away * math.sin(angle), x + away * math.cos(angle)
            own = float(texel(radius, down, across))
            weight = clamp(own - away + 0.5, 0, 1) * area / (math.pi * max(own, 0.5) ** 2)
            sums[y, x] += weight * texel(small, down, across)
            if away == 0.0:  # from the middle to the first of the spiral
                away, area = scale, 2 * math.pi * scale
            else:
                away, angle = away + scale / away, angle + GOLDEN_ANGLE
    sums = full_size(sums, *blur.shape)
    return sums[..., :3] / np.maximum(sums[..., 3:], 1e-6), np.minimum(sums[..., 3], 1)


def test_multi_pass_gather_composites_two_planes_over_the_sharp_picture():
    image, defocus = scene()
    far_share, near_share = np.clip(-defocus - 0.5, 0, 1), np.clip(defocus - 0.5, 0, 1)
    far, far_alpha = plane_of(image, np.maximum(-defocus, 0), far_share, 0.7)
    near, near_alpha = plane_of(image, np.maximum(defocus, 0), near_share, 0.7)
    expected = np.empty(image.shape)
    for y, x in np.ndindex(defocus.shape):
        share = max(far_share[y, x], near_share[y, x] * min(far_alpha[y, x] / 0.1, 1))
        color = image[y, x] + share * (far[y, x] - image[y, x])
        expected[y, x] = color + near_alpha[y, x] * (near[y, x] - color)
    result = baselines.gather_passes(image, defocus, scale=0.7)
    assert np.mean(np.abs(result - expected).max(axis=2) > 1e-4) < 0.05  # a place on the border of two texels


# The post-processes of games.


def prefiltered(image, defocus, coc, reach, y, x):
    """Nine taps around a pixel of half the size, no wider than its blur, weighed by blur and by Karis."""
    total, color = 0.0, np.zeros(3)
    for j in (-1, 0, 1):
        for i in (-1, 0, 1):
            if math.hypot(i, j) * reach > max(abs(2 * coc[y, x]), 1.5):
                continue
            down, across = 2 * y + 0.5 + reach * j, 2 * x + 0.5 + reach * i
            for row in (math.floor(down), math.floor(down) + 1):
                for column in (math.floor(across), math.floor(across) + 1):
                    light = texel(image, row, column)
                    weight = (1 - abs(row - down)) * (1 - abs(column - across)) / (1 + LUMA @ light)
                    weight *= max(1 - abs(float(texel(defocus, row, column)) - 2 * coc[y, x]) / 2, 0)
                    color, total = color + weight * light, total + weight
    return color / total if total > 0 else image[min(2 * y, len(image) - 1), 2 * x].astype(float)


@pytest.mark.parametrize(("name", "rings", "part"), [("jimenez", 3, 1 / 6), ("tan", 4, 1 / 8)])
def test_scatter_as_you_gather_is_its_passes_one_after_the_other(name, rings, part):
    image, defocus = scene()
    height, width = defocus.shape
    coc, light = np.zeros((9, 11)), np.zeros((9, 11, 3))
    for y, x in np.ndindex(coc.shape):
        coc[y, x] = min(four(defocus, y, x)) / 2
    for y, x in np.ndindex(coc.shape):
        reach = max(part * 2 * np.abs(tile_of(coc, y, x, 16)).max(), 1)
        light[y, x] = prefiltered(image, defocus, coc, reach, y, x)
    blurred = np.zeros((9, 11, 4))
    for y, x in np.ndindex(coc.shape):
        tile = tile_of(coc, y, x, 16)
        reach, nearest = np.abs(tile).max(), tile.max()
        near, far = np.zeros(4), np.zeros(4)
        for number, angle in rings_of(rings):
            away = number / rings * reach
            place = y + away * math.sin(angle), x + away * math.cos(angle)
            own = abs(float(texel(coc, *place)))
            cover = clamp(own * rings / reach - number + 1, 0, 1)
            weight = (cover**4 if number <= 1 else cover) / (math.pi * max(own * own, 0.5))
            behind = clamp((nearest - float(texel(coc, *place))) / 0.5, 0, 1)
            behind = behind * behind * (3 - 2 * behind)
            near += weight * (1 - behind) * np.append(texel(light, *place), 1)
            far += weight * behind * np.append(texel(light, *place), 1)
        taps = 1 + 4 * rings * (rings + 1)
        alpha = min(2 * near[3] / (taps / (math.pi * max(reach * reach, 0.5))), 1)
        if name == "tan" or min(near[3], far[3]) == 0:
            color = (near + far)[:3] / (near + far)[3] if (near + far)[3] > 0 else light[y, x]
        else:
            color = far[:3] / far[3] + alpha * (near[:3] / near[3] - far[:3] / far[3])
        blurred[y, x] = [*color, alpha]
    smooth = blurred.copy()
    for y, x in np.ndindex(coc.shape):
        around = [texel(blurred, y + j, x + i)[:3] for j in (-1, 0, 1) for i in (-1, 0, 1)]
        smooth[y, x, :3] = np.sort(around, axis=0)[4]
    smooth = full_size(smooth, height, width)
    expected = np.empty(image.shape)
    for y, x in np.ndindex(height, width):
        covered = smooth[y, x, 3] if tile_of(coc, y // 2, x // 2, 16).max() > math.sqrt(0.5) else 0
        share = max(clamp(abs(defocus[y, x]) / math.sqrt(0.5) - 1, 0, 1), covered)
        expected[y, x] = image[y, x] + share * (smooth[y, x, :3] - image[y, x])
    result = getattr(baselines, name)(image, defocus)
    assert np.mean(np.abs(result - expected).max(axis=2) > 1e-3) < 0.05  # a place on the border of two texels


def layer_of(light, coc, side, rings):
    """Light times coverage, and coverage, of Abadie's far (-1) or near (1) layer."""
    inside = np.maximum(coc, 0) if side > 0 else np.minimum(coc, 0)
    result = np.zeros((*coc.shape, 4))
    for y, x in np.ndindex(coc.shape):
        reach = max(np.abs(tile_of(inside, y, x, 16)).max(), 0.5)
        hidden = side < 0 and coc[y, x] > 0
        if hidden:
            reach = max(reach, coc[y, x])
        taps = [*rings_of(rings)]
        for number, angle in taps:
            away = number / rings * reach * rings / (rings + 0.5)
            down, across = away * math.sin(angle), away * math.cos(angle)
            if side < 0 and texel(coc, y + down, x + across) > 0:
                down, across = -down, -across
            radius = side * float(texel(coc, y + down, x + across))
            if radius < 0 or (radius == 0 and not hidden):
                continue
            weight = clamp(radius - away + 0.5, 0, 1) / (math.pi * max(radius * radius, 0.5))
            weight = 1.0 if hidden else weight * min(2 * radius, 1)
            weight *= math.pi * reach * reach / len(taps)
            result[y, x] += weight * np.append(texel(light, y + down, x + across), 1)
    return result


def sprites(lights, coc, side):
    result = np.zeros(lights.shape)
    for y, x in np.argwhere(lights.any(axis=2) & (side * coc > 0)):
        table = psf_image(Aperture(), round(4 * abs(float(coc[y, x]))) / 4, side)
        half = len(table) // 2
        for j, i in np.ndindex(table.shape):
            row, column = y + j - half, x + i - half
            if 0 <= row < len(result) and 0 <= column < result.shape[1]:
                result[row, column] += table[j, i] * lights[y, x]
    return result


def test_abadie_is_two_gathered_layers_with_sprites():
    image, defocus = scene()
    size = defocus.shape
    light, coc = half_size(image), half_size(defocus) / 2
    lights = np.zeros(light.shape)
    for y, x in np.ndindex(coc.shape):
        around = sum(texel(light, y + j, x + i) for j in (-1, 0, 1) for i in (-1, 0, 1)) - light[y, x]
        if LUMA @ light[y, x] > 3 * LUMA @ around / 8 and abs(coc[y, x]) > 1:
            lights[y, x] = np.maximum(light[y, x] - around / 8, 0)
    assert lights.any()
    far, near = (layer_of(light - lights, coc, side, 6) for side in (-1, 1))
    known = (far[..., 3:] > 0).astype(float)
    far_light = far[..., :3] / np.maximum(far[..., 3:], 1e-6) + sprites(lights, coc, -1)
    far = full_size(np.dstack([far_light * known, known]), *size)
    alpha = np.minimum(near[..., 3:], 1)
    near_light = near[..., :3] / np.maximum(near[..., 3:], 1e-6)
    near = full_size(np.dstack([near_light * alpha + sprites(lights, coc, 1), alpha]), *size)
    expected = np.empty(image.shape)
    for y, x in np.ndindex(size):
        color = image[y, x].astype(float)
        if far[y, x, 3] > 1e-3:
            share = clamp(abs(defocus[y, x]) - 0.5, 0, 1)
            color += share * (far[y, x, :3] / far[y, x, 3] - color)
        expected[y, x] = near[y, x, :3] + (1 - near[y, x, 3]) * color
    result = baselines.abadie(image, defocus)
    assert np.mean(np.abs(result - expected).max(axis=2) > 1e-3) < 0.05  # a place on the border of two texels


# Filters and spreading.


def test_diffusion_solves_its_system_for_all_rows_then_all_columns():
    image, defocus = scene()
    expected, steps = image.astype(float), 3
    conductivity = defocus.astype(float) ** 2 / (8 * steps)
    for _ in range(steps):
        for axis in (1, 0):
            for line in range(defocus.shape[1 - axis]):
                values, heat = (np.take(part, line, 1 - axis) for part in (expected, conductivity))
                slope = np.diff(np.eye(len(heat)), axis=0)
                system = np.eye(len(heat)) + slope.T @ np.diag(np.minimum(heat[:-1], heat[1:])) @ slope
                solved = np.linalg.solve(system, values)
                if axis == 1:
                    expected[line] = solved
                else:
                    expected[:, line] = solved
    assert np.abs(baselines.diffusion(image, defocus, steps=steps) - expected).max() < 1e-5


def mixed(radii, radius):
    """The two rungs beside a radius and their shares."""
    k = min(int(np.searchsorted(radii, radius, side="right")) - 1, len(radii) - 2)
    share = clamp((radius - radii[k]) / (radii[k + 1] - radii[k]), 0, 1)
    return ((k, 1 - share), (k + 1, share))


def add(sums, table, y, x, light):
    half = len(table) // 2
    for j, i in np.ndindex(table.shape[:2]):
        row, column = y + j - half, x + i - half
        if 0 <= row < len(sums) and 0 <= column < sums.shape[1]:
            sums[row, column] += table[j, i] * light


def test_lommel_spreads_the_spot_of_each_channels_wavelength():
    image, defocus = (array[:11, :13] for array in scene())
    radii = radius_ladder(float(np.abs(defocus).max()))
    expected = np.empty(image.shape)
    for channel, wavelength in enumerate(WAVELENGTHS):
        unit = wavelength * 2.8 / 5.0
        spots = [lommel_table(float(radius) if k else 0.0, unit) for k, radius in enumerate(radii)]
        sums = np.zeros((*defocus.shape, 2))
        for y, x in np.ndindex(defocus.shape):
            for k, share in mixed(radii, max(abs(float(defocus[y, x])), 0.5)):
                add(sums, spots[k][..., None], y, x, share * np.array([image[y, x, channel], 1]))
        expected[..., channel] = sums[..., 0] / sums[..., 1]
    assert np.abs(baselines.lommel(image, defocus) - expected).max() < 1e-5


def test_hybrid_spreading_draws_outlines_of_salient_pixels_and_squares_elsewhere():
    image, defocus = scene()
    threshold, sums, outlined = 0.2, np.zeros((*defocus.shape, 4)), 0
    grey = image.astype(float).mean(axis=2)
    for y, x in np.ndindex(defocus.shape):
        light, radius = np.append(image[y, x], 1).astype(float), abs(float(defocus[y, x]))
        around = grey[max(0, y - 4) : y + 5, max(0, x - 4) : x + 5]
        if abs(grey[y, x] - around.mean()) > threshold:
            outlined += 1
            side = 1 if defocus[y, x] > 0 else -1
            radii = radius_ladder(max(0.0, float((side * defocus).max())))
            for k, share in mixed(radii, radius) if len(radii) > 1 else ((0, 1.0),):
                if share > 0:
                    add(sums, psf_image(Aperture(), float(radii[k]), side)[..., None], y, x, share * light)
            continue
        half = max(math.sqrt(math.pi) / 2 * radius, 0.5)
        for row, column in np.ndindex(defocus.shape):
            down = clamp(min(row + 0.5, y + half) - max(row - 0.5, y - half), 0, 1)
            across = clamp(min(column + 0.5, x + half) - max(column - 0.5, x - half), 0, 1)
            sums[row, column] += down * across / (2 * half) ** 2 * light
    assert 0.2 < outlined / defocus.size < 0.8
    result = baselines.hybrid_spreading(image, defocus, threshold=threshold)
    assert np.abs(result - sums[..., :3] / sums[..., 3:]).max() < 1e-4


def test_lens_spreading_mixes_the_tables_of_four_places_and_two_blurs():
    """The tables themselves are held against the rays of the lens in ``test_lens_spreading.py``."""
    image, defocus = (array[:14, :18] for array in scene())
    response = LensResponse(chromatic_aberration=ChromaticAberration(axial=1, lateral=1))
    height, width = defocus.shape
    columns, rows = np.array([0.0, 8, 16, 24]), np.array([0.0, 8, 16])
    ladder = defocus_ladder(float(defocus.min()), float(defocus.max()))
    lights = np.ones((len(ladder) * 12, 8))
    lights[:, :3] = [(column, row, rung) for rung in ladder for row in rows for column in columns]
    tables, starts, halves = traced_tables(Aperture(), response, lights, (height, width))
    sums = np.zeros((height, width, 6))
    for y, x in np.ndindex(height, width):
        rung = float(defocus[y, x])
        for k, up in mixed(ladder, rung):
            for j, down in mixed(rows, y):
                for i, right in mixed(columns, x):
                    at, side = 12 * k + 4 * j + i, 2 * halves[12 * k + 4 * j + i] + 1
                    table = tables[starts[at] : starts[at] + side**2].reshape(side, side, 3)
                    light = up * down * right * np.concatenate([image[y, x], np.ones(3)])
                    add(sums, np.dstack([table, table]), y, x, light)
    result = baselines.lens_spreading(image, defocus, lens_response=response)
    assert np.abs(result - sums[..., :3] / sums[..., 3:]).max() < 1e-5


def test_profile_spreading_mixes_the_ring_means_of_two_blurs():
    """Rings of half a pixel about the point on the axis; nothing changes over the picture."""
    image, defocus = (array[:13, :17] for array in scene())
    response = LensResponse(chromatic_aberration=ChromaticAberration(axial=1, lateral=1))
    ladder = defocus_ladder(float(defocus.min()), float(defocus.max()))
    lights = np.ones((len(ladder), 8))
    lights[:, :3] = [(8, 6, rung) for rung in ladder]
    tables, starts, halves = traced_tables(Aperture(), response, lights, defocus.shape)
    profiles = []
    for start, half in zip(starts, halves, strict=True):
        side = 2 * half + 1
        table = tables[start : start + side**2].reshape(side, side, 3)
        rings = {}
        for v, u in np.ndindex(side, side):
            rings.setdefault(round(2 * math.hypot(v - half, u - half)), []).append(table[v, u])
        profile = [
            [np.mean(rings[round(2 * math.hypot(v - half, u - half))], axis=0) for u in range(side)]
            for v in range(side)
        ]
        profiles.append(np.array(profile))
    sums = np.zeros((*defocus.shape, 6))
    for y, x in np.ndindex(defocus.shape):
        for k, up in mixed(ladder, float(defocus[y, x])):
            light = up * np.concatenate([image[y, x], np.ones(3)])
            add(sums, np.dstack([profiles[k], profiles[k]]), y, x, light)
    result = baselines.profile_spreading(image, defocus, lens_response=response)
    assert np.abs(result - sums[..., :3] / sums[..., 3:]).max() < 1e-5


# Rays through a picture.


def test_image_rays_meet_the_first_square_of_all():
    """Each ray against every square, those of the border's values beyond it too; no bounds and no walk."""
    image, defocus = (array[2:13, 3:15] for array in scene())
    depth, samples, beyond = -defocus.astype(float), 8, 7
    slack = max(0.01 * (depth.max() - depth.min()), 1e-3)
    rng = np.random.default_rng(0)
    patterns = [disc_from_square(sobol(samples, rng)) for _ in range(256)]
    wide, near, far = np.pad(depth, beyond, mode="edge"), depth.min() - slack, depth.max() + slack
    low_y, low_x = np.mgrid[: wide.shape[0], : wide.shape[1]] - beyond
    expected = np.zeros(image.shape)
    for y, x in np.ndindex(depth.shape):
        met = []
        for u, v in patterns[int(random_number(x, y, 0) * 256)]:
            enter, leave = np.full(wide.shape, near), np.full(wide.shape, far)
            for way, low, middle in ((u, low_x, x + 0.5), (v, low_y, y + 0.5)):
                ends = np.sort([(low - middle) / way, (low + 1 - middle) / way], axis=0)
                enter, leave = np.maximum(enter, ends[0]), np.minimum(leave, ends[1])
            inside = (enter < leave) & (enter < wide) & (wide <= leave + slack)
            first = np.unravel_index(np.where(inside, enter, np.inf).argmin(), wide.shape)
            if inside[first]:
                met.append(texel(image, low_y[first], low_x[first]))
        expected[y, x] = np.mean(met, axis=0) if met else image[y, x]
    result = baselines.image_rays(image, defocus, samples=samples)
    assert np.mean(np.abs(result - expected).max(axis=2) > 1e-4) < 0.05  # a ray through a corner
