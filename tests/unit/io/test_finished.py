"""Existing outputs against files that are cut at every place: only the whole file is finished."""

import numpy as np
import pytest

from bokehnet.io.formats.finished import is_finished
from bokehnet.io.image import IMAGE_EXTENSIONS, write_image

PICTURE = np.random.default_rng(0).random((40, 56, 3), dtype=np.float32)


@pytest.mark.parametrize("extension", [x for x in IMAGE_EXTENSIONS if x not in (".avif", ".heic", ".heif")])
def test_a_file_is_finished_only_if_it_is_whole(tmp_path, extension):
    """Authority: the writer, whose files are whole, and the same bytes without their end."""
    path, cut = tmp_path / f"whole{extension}", tmp_path / f"cut{extension}"
    write_image(path, PICTURE)
    data = path.read_bytes()
    assert is_finished(path)
    for fraction in (0, 0.01, 0.3, 0.8, 0.97):
        cut.write_bytes(data[: int(fraction * len(data))])
        assert not is_finished(cut), fraction


@pytest.mark.parametrize("extension", [".jpg", ".png", ".tif", ".exr", ".webp", ".jxl"])
def test_space_that_was_reserved_and_not_written_is_not_finished(tmp_path, extension):
    """Authority: the writer; a file system that loses power keeps the length, with zeros in place of data."""
    path = tmp_path / f"reserved{extension}"
    write_image(path, PICTURE)
    data = path.read_bytes()
    kept = len(data) // 3
    path.write_bytes(data[:kept] + bytes(len(data) - kept))
    assert not is_finished(path)


def test_a_file_of_another_size_is_not_finished(tmp_path):
    for name, picture in (("source.png", PICTURE), ("same.exr", PICTURE), ("other.png", PICTURE[:39])):
        write_image(tmp_path / name, picture)
    write_image(tmp_path / "half.png", PICTURE[::2, ::2])
    write_image(tmp_path / "upright.jpg", PICTURE.transpose(1, 0, 2))
    source = tmp_path / "source.png"
    assert is_finished(tmp_path / "same.exr", source)
    assert is_finished(tmp_path / "upright.jpg", source)
    assert is_finished(tmp_path / "half.png", source, 2)
    assert not is_finished(tmp_path / "other.png", source)
    assert not is_finished(tmp_path / "half.png", source)


def test_missing_files_and_folders_are_not_finished(tmp_path):
    assert not is_finished(tmp_path / "none.png")
    assert not is_finished(tmp_path)
