"""Maps in false colours. Authority: matplotlib's colour maps, and the values before colouring."""

import numpy as np
import pytest
from PIL import Image

from bokehnet.errors import ImageFileError
from bokehnet.io.depth.false_colors import COLOR_MAPS, TABLES_FILE, decode_colors
from bokehnet.io.maps import read_stored_map

matplotlib = pytest.importorskip("matplotlib", reason="needs matplotlib, the authority of the colours")


def scene(height=120, width=160):
    """Disparity of a slope, a disc and a small bar, 0 to 1."""
    y, x = np.mgrid[:height, :width]
    values = 0.1 + 0.3 * y / height
    values = np.where((x - 80) ** 2 + (y - 60) ** 2 < 35**2, 0.75 + 0.002 * (y - 60), values)
    values[20:30, 10:50] = 1.0
    values[100:, :20] = 0.0
    return values


def colored(values, name):
    return (255 * matplotlib.colormaps[name](values)[..., :3] + 0.5).astype(np.uint8)


@pytest.mark.parametrize("name", COLOR_MAPS)
def test_png_maps_are_decoded(name, tmp_path):
    path = tmp_path / "map.png"
    Image.fromarray(colored(scene(), name)).save(path)
    stored = read_stored_map(path)
    assert stored.assumptions == (f"colours of {name}",)
    runs = 3 if name == "jet" else 1  # jet repeats colours over up to five levels
    assert np.abs(stored.values - scene()).max() < runs / 255


@pytest.mark.parametrize("name", COLOR_MAPS)
def test_an_alpha_channel_does_not_matter(name, tmp_path):
    path = tmp_path / "map.png"
    Image.fromarray(colored(scene(), name)).convert("RGBA").save(path)
    assert read_stored_map(path).assumptions == (f"colours of {name}",)


@pytest.mark.parametrize("quality", [75, 95])
@pytest.mark.parametrize("name", COLOR_MAPS)
def test_jpeg_maps_are_decoded(name, quality, tmp_path):
    """Compression and chroma subsampling leave at most 1 % of the values wrong by more than 0.05."""
    path = tmp_path / "map.jpg"
    Image.fromarray(colored(scene(240, 320), name)).save(path, quality=quality)
    stored = read_stored_map(path)
    assert stored.assumptions == (f"colours of {name}",)
    known = np.isfinite(stored.values)
    assert known.mean() > 0.95
    assert np.mean(np.abs(stored.values - scene(240, 320))[known] > 0.05) < 0.01


@pytest.mark.parametrize("name", ["cividis", "coolwarm", "gist_earth", "hsv", "twilight"])
def test_other_colour_maps_are_refused_with_the_way_out(name, tmp_path):
    path = tmp_path / "map.png"
    Image.fromarray(colored(scene(), name)).save(path)
    with pytest.raises(ImageFileError, match=r"colour picture.*turbo.*depth.coding"):
        read_stored_map(path)


def test_photographs_are_refused(shared):
    for photo in sorted(shared("real").glob("*.jpg"))[:6]:
        with pytest.raises(ImageFileError, match="colour picture"):
            read_stored_map(photo)


def test_a_named_coding_needs_its_colours(tmp_path):
    path = tmp_path / "map.png"
    Image.fromarray(colored(scene(), "viridis")).save(path)
    with pytest.raises(ImageFileError, match="are not of the colour map jet"):
        read_stored_map(path, coding="jet")
    Image.fromarray((255 * scene()).astype(np.uint8)).save(path)
    with pytest.raises(ImageFileError, match="turbo needs colours"):
        read_stored_map(path, coding="turbo")


def test_two_values_alone_fit_no_map_or_their_own(tmp_path):
    """Few colours may belong to several maps: the result is the right map, or an error."""
    for name in COLOR_MAPS:
        for ends in ((0.0, 1.0), (0.2, 0.8), (0.45, 0.55)):
            values = np.where(np.arange(4000).reshape(50, 80) % 7 < 3, *ends)
            path = tmp_path / "map.png"
            Image.fromarray(colored(values, name)).save(path)
            try:
                stored = read_stored_map(path)
            except ImageFileError:
                continue
            assert stored.assumptions == (f"colours of {name}",)
            assert np.abs(stored.values - values).max() < 3 / 255


def test_blended_colours_have_no_value():
    colors = np.array([[[0.5, 0.5, 0.5]]])  # grey: in none of the rainbow's colours
    assert np.isnan(decode_colors(colors, "turbo")).all()


def test_the_stored_tables_are_those_of_the_tool():
    from tools.color_tables import color_tables

    assert (np.load(TABLES_FILE) == color_tables()).all()
