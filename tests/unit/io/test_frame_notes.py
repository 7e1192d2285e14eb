"""Notes about files of other programs that a frame cannot hold whole."""

import numpy as np
import pytest

from bokehnet.io.frame import read_frame


@pytest.mark.parametrize("name", ["ink.jpg", "ink.tif"])
def test_inks_without_a_profile_are_noted(tmp_path, name):
    """Authority: Pillow, which writes CMYK."""
    image = pytest.importorskip("PIL.Image")
    image.fromarray(np.full((8, 12, 3), 90, np.uint8)).convert("CMYK").save(tmp_path / name)
    assert any("CMYK" in note for note in read_frame(tmp_path / name).notes)


@pytest.mark.parametrize(
    ("name", "size", "noted"), [("two.tif", 1, True), ("two.webp", 1, True), ("thumb.tif", 4, False)]
)
def test_further_pages_are_noted_and_thumbnails_are_not(tmp_path, name, size, noted):
    """Authority: Pillow, which writes the pages; a smaller page is a thumbnail."""
    image = pytest.importorskip("PIL.Image", reason="needs Pillow")
    first, second = (image.new("RGB", (48 // part, 32 // part), (40 * part, 90, 20)) for part in (1, size))
    if size == 1:
        second.paste((200, 10, 10), (4, 4, 20, 20))
    first.save(tmp_path / name, save_all=True, append_images=[second])
    assert any("only the first" in note for note in read_frame(tmp_path / name).notes) == noted
