"""Colour profiles, against LittleCMS."""

import io

import numpy as np
import pytest
from numpy.testing import assert_allclose

from bokehnet.errors import ImageFileError
from bokehnet.io.color.color_space import COLOR_SPACES, LINEAR_REC709, SRGB, convert
from bokehnet.io.color.icc import make_profile, read_profile
from tests.unit.io.color import profiles

# LittleCMS works in 16 bits here and hands out 8: half a level of rounding, and a little of its own.
LEVELS = 0.75


def shown_by_littlecms(profile, stored):
    """sRGB of 8-bit colours (n, 3), media-relative, as LittleCMS computes them."""
    Image = pytest.importorskip("PIL.Image", reason="converts with LittleCMS")  # noqa: N806
    ImageCms = pytest.importorskip("PIL.ImageCms", reason="converts with LittleCMS")  # noqa: N806

    srgb = ImageCms.createProfile("sRGB")
    original = ImageCms.ImageCmsProfile(io.BytesIO(profile))
    transform = ImageCms.buildTransform(
        original, srgb, "RGB", "RGB", ImageCms.Intent.RELATIVE_COLORIMETRIC, ImageCms.Flags.NOOPTIMIZE
    )
    picture = ImageCms.applyTransform(Image.fromarray(stored[None]), transform)
    return np.asarray(picture)[0].astype(float)


def colours():
    """Colours all over the cube, and greys."""
    rng = np.random.default_rng(0)
    greys = np.repeat(np.arange(0, 256, 5)[:, None], 3, axis=1)
    return np.concatenate([rng.integers(0, 256, (2000, 3)), greys]).astype(np.uint8)


@pytest.mark.parametrize("name", profiles.KNOWN)
def test_profiles_show_what_littlecms_shows(name):
    """Table curves, gammas, parametric curves of several kinds; colours of each channel apart."""
    stored = colours()
    space = read_profile(profiles.KNOWN[name], "a.jpg")
    light = convert(space.decode(stored[None].astype(np.float32) / 255), space, SRGB)
    shown = 255 * SRGB.encode(np.clip(light, 0, 1))[0]
    assert_allclose(shown, shown_by_littlecms(profiles.KNOWN[name], stored), atol=LEVELS)


@pytest.mark.parametrize("name", ["display-p3", "adobe-rgb", "prophoto", "rec2020", "srgb"])
def test_made_profiles_mean_to_littlecms_what_they_mean_here(name):
    stored, space = colours(), COLOR_SPACES[name]
    light = convert(space.decode(stored[None].astype(np.float32) / 255), space, SRGB)
    shown = 255 * SRGB.encode(np.clip(light, 0, 1))[0]
    assert_allclose(shown, shown_by_littlecms(make_profile(space), stored), atol=LEVELS)
    again = read_profile(make_profile(space), "a.jpg")
    assert (again.name, again.shares_primaries(space)) == (space.name, True)


@pytest.mark.parametrize(
    ("name", "columns"),
    [("adobe-rgb", profiles.ADOBE), ("display-p3", profiles.P3), ("prophoto", profiles.PROPHOTO)],
)
def test_named_spaces_have_the_colorants_of_the_usual_profiles(name, columns):
    """Values in the profiles of Adobe, Apple and Kodak; their s15Fixed16 and white round by 2e-4."""
    assert_allclose(np.transpose(COLOR_SPACES[name].to_pcs), columns, atol=2e-4)


@pytest.mark.parametrize("name", profiles.KNOWN)
@pytest.mark.parametrize("top", [255, 65535])
def test_every_level_comes_back(name, top):
    space = read_profile(profiles.KNOWN[name], "a.png")
    levels = np.arange(top + 1)
    stored = np.repeat(levels[None, :, None].astype(np.float32) / np.float32(top), 3, axis=2)
    again = np.rint(space.encode(space.decode(stored)).astype(np.float64) * top)
    assert np.abs(again[0] - levels[:, None]).max() <= (1 if name == "scanner" and top == 65535 else 0)


def test_light_above_white_and_below_black_is_kept():
    space = read_profile(profiles.KNOWN["adobe"], "a.tif")
    light = space.decode(np.array([[[-0.5, 1.5, 2.0]]], np.float32))
    assert_allclose(light[0, 0], [-(0.5 ** (563 / 256)), 1.5 ** (563 / 256), 2 ** (563 / 256)], rtol=1e-5)


def test_a_grey_profile_has_one_curve():
    space = read_profile(profiles.grey_profile(profiles.gamma(1.8)), "a.jpg")
    assert space.grey
    assert_allclose(space.decode(np.array([0.5])), 0.5 ** (round(1.8 * 256) / 256))


def test_a_linear_profile_is_linear():
    curve = b"curv" + bytes(8)
    assert read_profile(profiles.matrix_profile(profiles.P3, [curve] * 3), "a.tif").is_linear
    straight = profiles.parametric(3, 1, 1, 0, 1, 0)
    assert read_profile(profiles.matrix_profile(profiles.P3, [straight] * 3), "a.tif").is_linear


@pytest.mark.parametrize(
    ("profile", "reason"),
    [
        (b"no profile", "damaged .*do not begin with a profile.*remove it"),
        (profiles.KNOWN["p3"][:200], "damaged .*beyond its end"),
        (
            profiles.profile(b"RGB ", {b"desc": profiles.named("lut"), b"A2B0": b"mft2"}),
            "'lut', RGB by a table",
        ),
        (profiles.profile(b"CMYK", {b"desc": profiles.named("press"), b"A2B0": b"mft2"}), "'press', CMYK by"),
        (profiles.matrix_profile([profiles.D50] * 3, [profiles.gamma(2)] * 3, "flat"), "'flat'.*on one line"),
        (profiles.matrix_profile(profiles.P3, [profiles.table([1, 0])] * 3, "down"), "a curve falls"),
        (profiles.matrix_profile(profiles.P3, [b"mft2" + bytes(20)] * 3, "odd"), "unknown type 'mft2'"),
        (profiles.matrix_profile(profiles.P3, [profiles.parametric(3, 0, 1, 0, 1, 0)] * 3), "does not rise"),
    ],
)
def test_a_track_that_is_lost_is_reported_with_the_way_out(profile, reason):
    with pytest.raises(
        ImageFileError, match=f"^a.jpg: .*{reason}.*convert the picture to sRGB or Display P3"
    ):
        read_profile(profile, "a.jpg")


def test_a_table_next_to_the_matrix_is_reported():
    both = profiles.matrix_profile(profiles.P3, [profiles.gamma(2)] * 3, "both", A2B0=b"mft2" + bytes(8))
    assert "both" in read_profile(both, "a.jpg").note
    assert read_profile(profiles.KNOWN["p3"], "a.jpg").note == ""


def test_damage_anywhere_is_a_profile_or_one_line():
    """Random bytes in a valid profile."""
    rng = np.random.default_rng(0)
    whole = np.frombuffer(profiles.KNOWN["p3"], np.uint8)
    for _ in range(300):
        broken = whole.copy()
        broken[rng.integers(128, len(whole), 4)] = rng.integers(0, 256, 4)
        try:
            space = read_profile(broken.tobytes(), "a.jpg")
        except ImageFileError:
            continue
        assert np.isfinite(space.encode(np.clip(space.decode(np.linspace(0, 1, 9)[:, None]), 0, 1))).all()


def test_linear_rec709_shares_the_primaries_of_srgb():
    assert LINEAR_REC709.shares_primaries(SRGB)
    assert not SRGB.shares_primaries(COLOR_SPACES["display-p3"])
