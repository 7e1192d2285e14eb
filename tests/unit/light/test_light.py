"""Detection and recovery of clipped light: what is found, what is left alone, what bad input gets."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.ndimage import gaussian_filter
from scipy.special import erf

from bokehnet.io.color.srgb import linear_to_srgb, srgb_to_linear
from bokehnet.light.clip_level import clip_levels
from bokehnet.light.components import connected_components
from bokehnet.light.config import DEFAULT_CONFIG
from bokehnet.light.recovery import recover_light

HEIGHT, WIDTH = 160, 240


def stored(light, top=255):
    """Return the light that an 8-bit file of ``light`` holds."""
    codes = np.round(linear_to_srgb(np.clip(light, 0, 1).astype(np.float32)) * top)
    return srgb_to_linear((codes / 255).astype(np.float32))


def noisy(mean, rng, spread=0.1):
    grain = 1 + spread * rng.standard_normal((HEIGHT, WIDTH, 1))
    return (mean * grain * np.ones(3)).clip(0).astype(np.float32)


def night(rng, lamps, color=(1.0, 1.0, 1.0), halo=0.0, wall=0.006):
    """A dark wall with lamps of (row, column, radius, radiance); with a halo of ``halo / (pi^3 r^3)``."""
    light = noisy(wall, rng)
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    for row, column, radius, radiance in lamps:
        distance = np.hypot(y - row, x - column)
        cover = np.clip(radius + 0.5 - distance, 0, 1)
        flux = np.pi * radius**2 * radiance
        glow = flux * halo / (np.pi**3 * np.maximum(distance, radius + 0.5) ** 3)
        light += ((cover * radiance + glow)[..., None] * color).astype(np.float32)
    return light


def sky(rng, radiance=4.0):
    """Sky in the upper half behind vertical trunks; ground below. With its disparity."""
    light, near = noisy(0.05, rng), np.full((HEIGHT, WIDTH), 0.4, np.float32)
    for left in range(0, WIDTH, 24):
        light[:80, left : left + 14] = radiance * np.array([0.9, 1.0, 1.15])
        near[:80, left : left + 14] = 0
    return light, near


@pytest.mark.parametrize("seed", range(20))
def test_components_are_those_of_a_flood_fill(seed):
    """Oracle: pixels joined one after another."""
    rng = np.random.default_rng(seed)
    mask = rng.random(rng.integers(1, 20, 2)) < rng.random()
    expected = np.where(mask, np.arange(mask.size).reshape(mask.shape), -1)
    for _ in range(mask.size):
        for axis in (0, 1):
            for one, other in ((slice(None, -1), slice(1, None)), (slice(1, None), slice(None, -1))):
                a = [slice(None), slice(None)]
                b = [slice(None), slice(None)]
                a[axis], b[axis] = one, other
                touch = mask[tuple(a)] & mask[tuple(b)]
                lower = np.minimum(expected[tuple(a)], expected[tuple(b)])
                expected[tuple(a)] = np.where(touch, lower, expected[tuple(a)])
    components = connected_components(mask)
    labels = expected[components.rows, components.columns]
    assert_array_equal(np.stack([components.rows, components.columns]), np.nonzero(mask))
    assert components.count == len(np.unique(labels))
    pairs = np.unique(np.stack([labels, components.labels]), axis=1)
    assert pairs.shape[1] == components.count
    assert components.sums().sum() == mask.sum()


@pytest.mark.parametrize("top", [255, 252, 249])
def test_the_clip_level_is_where_the_camera_ends(top):
    rng = np.random.default_rng(1)
    light = np.exp(rng.normal(-2, 1.5, (HEIGHT, WIDTH, 1))) * np.ones(3)
    levels = clip_levels(stored(light, top), lowest=248, min_pixels=8, min_pile=2.5, margin=3)
    assert [level.code for level in levels] == [top] * 3


def test_lamps_get_the_flux_of_their_halo():
    """Authority: the flux that the scene has. Within a factor of 4.5: the core is sharper than assumed."""
    rng = np.random.default_rng(2)
    places = [(40, 40, 1.0, 100.0), (40, 120, 1.0, 300.0), (100, 60, 1.0, 30.0), (110, 180, 1.0, 200.0)]
    light = night(rng, places, color=(1.0, 0.6, 0.25), halo=DEFAULT_CONFIG.diffraction)
    recovered = recover_light(stored(light)).image
    for row, column, *_ in places:
        around = (slice(row - 12, row + 13), slice(column - 12, column + 13))
        original, true = recovered[around].sum((0, 1)), light[around].sum((0, 1))
        assert np.all(original / true > 1 / 4.5), (row, column, original / true)
        assert np.all(original / true < 2), (row, column, original / true)
        assert np.all(stored(light)[around].sum((0, 1)) <= original)


def test_lamps_keep_their_colour():
    """Blue is not clipped: white cores over an amber halo."""
    light = night(
        np.random.default_rng(3), [(80, 120, 1.5, 60.0)], (1.0, 0.5, 0.01), DEFAULT_CONFIG.diffraction
    )
    flux = recover_light(stored(light)).image[60:100, 100:140].sum((0, 1))
    assert 0.3 < flux[1] / flux[0] < 0.75
    assert flux[2] / flux[0] < 0.1


@pytest.mark.parametrize("radiance", [1.6, 2.5, 3.2])
@pytest.mark.parametrize("color", [(1.0, 0.24, 0.08), (0.1, 0.22, 1.0), (1.0, 0.55, 0.2)])
def test_an_unclipped_channel_measures_a_lamp_of_one_colour(color, radiance):
    """Truth: the flux of each lamp. Tail lights, neon and amber lamps clip in one or two channels."""
    places = [(40.3, 40.1, 3.2, radiance), (40.2, 120.4, 3.6, radiance), (110.1, 80.2, 2.9, radiance)]
    light = night(np.random.default_rng(6), places, color)
    recovered = recover_light(stored(light)).image
    for row, column, *_ in places:
        y, x = round(row), round(column)
        around = (slice(y - 8, y + 9), slice(x - 8, x + 9))
        assert_allclose(recovered[around].sum((0, 1)), light[around].sum((0, 1)), rtol=0.25)


def test_at_dusk_the_sharpness_of_edges_tells_lamps_from_white_matter():
    """Truth: lamps of 40 times white, and discs just above white, before a wall too bright for the night."""
    rng, radii = np.random.default_rng(8), np.random.default_rng(9).uniform(2.2, 3.4, 24)
    places = [(20 + 40 * (i // 6) + rng.random(), 20 + 40 * (i % 6) + rng.random()) for i in range(24)]

    def recovered(radiance):
        lamps = [(*place, radius, radiance) for place, radius in zip(places, radii, strict=True)]
        light = night(np.random.default_rng(8), lamps, wall=0.045)
        light = gaussian_filter(light, (0.6, 0.6, 0))  # of a camera
        return light, stored(light), recover_light(stored(light)).image

    light, original, image = recovered(40.0)
    assert original.sum() < 0.2 * light.sum()
    assert 0.3 * light.sum() < image.sum() < 1.5 * light.sum()
    _, original, image = recovered(1.1)
    assert_array_equal(image, original)


def test_by_day_a_single_clipped_channel_is_left_alone():
    """Saturated petals, clothes and skies clip in one channel."""
    light = noisy(0.2, np.random.default_rng(7))
    light[40:80, 60:140] *= np.array([8.0, 1.0, 0.5], np.float32)
    original = stored(light)
    assert recover_light(original).image is original


def test_a_sky_behind_trees_is_brightened_and_bluish():
    light, near = sky(np.random.default_rng(4))
    original = stored(light)
    recovered = recover_light(original, near)
    assert_allclose(recovered.image[:80, 5].mean(), 4, rtol=0.7)
    assert_array_equal(recovered.image[80:], original[80:])
    assert recovered.note.endswith("x white")


@pytest.mark.parametrize("radiance", [1.5, 3.0, 5.0])
def test_oblique_edges_measure_the_radiance_of_a_sky(radiance):
    """Authority: the known radiance behind trunks, through a Gaussian point spread function of .4 pixels."""
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    distance = (x * np.cos(0.3) + y * np.sin(0.3)) % 24 - 12
    cover = 0.5 * (1 + erf((6 - np.abs(distance)) / (np.sqrt(2) * np.hypot(0.4, np.sqrt(1 / 12)))))
    light = noisy(0.05, np.random.default_rng(5)) * (1 - cover[..., None]) + radiance * cover[..., None]
    recovered = recover_light(stored(light), np.where(np.abs(distance) < 7, 0, 0.4).astype(np.float32))
    measured = np.median(recovered.image[np.abs(distance) < 3].min(-1))
    assert_allclose(measured, radiance, rtol=0.4)


@pytest.mark.parametrize("level", [1.0, 1.05, 1.1])
def test_white_houses_in_the_farthest_layer_are_left_alone(level):
    """Their shading crosses the clip level, up to a fifth above it; without its measure they are light."""
    rng = np.random.default_rng(8)
    light, near = noisy(0.08, rng), np.full((HEIGHT, WIDTH), 0.6, np.float32)
    for top in (16, 64, 112):
        for left in (16, 80, 144, 200):
            wall = np.s_[top : top + 16, left : left + 24]
            light[wall], near[wall] = (level * np.linspace(0.82, 1.1, 24))[None, :, None], 0
    original = stored(light)
    assert recover_light(original, near).image is original
    unmeasured = replace(DEFAULT_CONFIG, shading=((-2.0, -1.0), (-2.0, -1.0)))
    assert recover_light(original, near, config=unmeasured).largest > 1.5


def test_strength_scales_the_excess():
    light, near = sky(np.random.default_rng(4))
    original = stored(light)
    whole, half = recover_light(original, near).image, recover_light(original, near, 0.5).image
    assert_allclose(half - original, 0.5 * (whole - original), atol=1e-5)
    assert recover_light(original, near, 0.0).image is original


def _paper(rng):
    return noisy(0.9, rng, 0.03)


def _shaded_cards(rng):
    light = noisy(0.15, rng)
    for top, left in ((20, 30), (60, 120), (90, 20)):
        light[top : top + 50, left : left + 60] = np.linspace(0.7, 1.15, 60)[:, None]
    return light


def _small_petals(rng):
    light = noisy(0.04, rng)
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    for _ in range(25):
        distance = np.hypot(y - rng.integers(10, 150), x - rng.integers(10, 230))
        light = np.where(
            (distance < 7)[..., None], (1.1 - 0.06 * distance)[..., None] * [1, 0.95, 0.93], light
        )
    return light


def _snow(rng):
    light = noisy(0.95, rng, 0.08)
    light[:40] = 0.5
    return light


def _skin(rng):
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    shine = np.exp(-((y - 80) ** 2 + (x - 120) ** 2) / 300)
    return noisy(0.4, rng, 0.03) * np.array([1, 0.75, 0.6]) + 0.8 * shine[..., None]


def _wall(rng):
    light = noisy(0.7, rng, 0.02)
    light[30:120, 60:160] *= 1.6
    return light


def _screenshot(rng):
    light = np.full((HEIGHT, WIDTH, 3), 1.0)
    light[:20] = (0.1, 0.2, 0.5)
    for row in range(30, 150, 8):
        light[row : row + 3, 10 : 10 + rng.integers(60, 200)] = 0.02
    return light


def _dark_screenshot(rng):
    light = np.full((HEIGHT, WIDTH, 3), 0.03)
    for row in range(10, 150, 8):
        for column in range(10, 200, 7):
            light[row : row + 4, column : column + rng.integers(2, 6)] = 1.0
    return light


def _drawing(rng):
    light = np.ones((HEIGHT, WIDTH, 3))
    for _ in range(30):
        top, left = rng.integers(0, 120), rng.integers(0, 200)
        light[top : top + rng.integers(5, 40), left : left + rng.integers(5, 40)] = rng.random(3)
    return light


def _text_page(rng):
    light = noisy(1.1, rng, 0.02)
    for row in range(10, 150, 7):
        light[row : row + 2, 12:228] = np.where(
            rng.random((1, 216, 1)) < 0.6, 0.05, light[row : row + 2, 12:228]
        )
    return light


NEGATIVES = {
    name: make
    for name, make in globals().items()
    if name
    in (
        "_paper",
        "_shaded_cards",
        "_small_petals",
        "_snow",
        "_skin",
        "_wall",
        "_screenshot",
        "_dark_screenshot",
        "_drawing",
        "_text_page",
    )
}


@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("jpeg", [False, True], ids=["clean", "noisy"])
@pytest.mark.parametrize("name", NEGATIVES)
def test_bright_matter_is_left_alone(name, seed, jpeg):
    """White things are not light. ``noisy`` has the noise of a JPEG."""
    rng = np.random.default_rng(seed)
    light = NEGATIVES[name](rng)
    if jpeg:
        light = light + 0.01 * rng.standard_normal(light.shape)
    original = stored(light)
    near = np.linspace(0, 1, HEIGHT, dtype=np.float32)[:, None] * np.ones((1, WIDTH), np.float32)
    assert recover_light(original, near).image is original
    assert recover_light(original).image is original


@pytest.mark.parametrize(
    "image",
    [
        np.zeros((HEIGHT, WIDTH, 3), np.float32),
        np.ones((HEIGHT, WIDTH, 3), np.float32),
        np.ones((1, 1, 3), np.float32),
        np.full((40, 50, 3), 0.18, np.float32),
        np.full((HEIGHT, WIDTH, 3), np.nan, np.float32),
        np.full((HEIGHT, WIDTH, 3), 5.0, np.float32),
        np.zeros((0, 4, 3), np.float32),
    ],
    ids=["black", "all clipped", "one pixel", "grey", "NaN", "all above white", "empty"],
)
def test_pictures_without_light_stay_as_they_are(image):
    assert recover_light(image, np.zeros(image.shape[:2], np.float32)).image is image


def test_recovery_is_finite_next_to_the_border():
    light = night(
        np.random.default_rng(5), [(0, 0, 2, 100), (HEIGHT - 1, WIDTH - 1, 3, 50), (80, 0, 1.5, 80)]
    )
    assert np.isfinite(recover_light(stored(light)).image).all()


def test_matter_in_front_of_a_lamp_is_neither_its_halo_nor_its_light():
    """Truth: the ratio of the light of two equal lamps, one of which a bright leaf covers in part."""
    rng = np.random.default_rng(0)
    light = night(rng, [(80, 60, 3, 20.0), (80, 160, 3, 20.0)], halo=0.4)
    free, covered = np.s_[60:101, 40:81], np.s_[60:101, 140:160]
    expected = light[covered].sum() / light[free].sum()
    near = np.zeros((HEIGHT, WIDTH), np.float32)
    leaf = np.s_[66:110, 160:200]
    light[leaf], near[leaf] = (0.35, 0.45, 0.1), 1
    image = stored(light)
    recovered = recover_light(image, near).image
    assert_array_equal(recovered[leaf], image[leaf])
    assert recovered[covered].sum() / recovered[free].sum() == pytest.approx(expected, rel=0.1)


def test_light_of_a_lamp_smaller_than_its_glare_has_the_depth_of_its_middle():
    """The map shows the bulb before a wall, and the wall where its glare clips."""
    light = night(np.random.default_rng(0), [(80, 60, 1, 300.0), (40, 160, 1, 300.0)], halo=0.4)
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    bulb = (np.hypot(y - 80, x - 60) < 1.5) | (np.hypot(y - 40, x - 160) < 1.5)
    image = stored(light)
    excess = (recover_light(image, np.where(bulb, 0.4, 0).astype(np.float32)).image - image).max(-1)
    assert ((image.max(-1) == 1) & ~bulb).sum() > bulb.sum()
    assert (excess[bulb] > 10).all()
    assert_array_equal(excess[~bulb], 0)
