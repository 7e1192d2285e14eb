"""Figures as files: refused before they are drawn, never half written."""

import pytest

from bokehnet.errors import ImageFileError
from bokehnet.tools.figure_file import write_figure


def test_an_unknown_ending_is_an_error(tmp_path):
    with pytest.raises(ImageFileError, match=r"lens\.xyz: unknown extension '\.xyz', expected one of \.png"):
        write_figure(None, tmp_path / "lens.xyz", dpi=100)


def test_what_fails_while_it_is_drawn_leaves_the_older_file(tmp_path):
    class Torn:
        def savefig(self, path, dpi):
            path.write_bytes(b"half a pict")
            raise OSError(28, "No space left on device")

    path = tmp_path / "lens.png"
    path.write_bytes(b"older")
    with pytest.raises(ImageFileError, match="any older file is kept: No space left"):
        write_figure(Torn(), path, dpi=100)
    assert path.read_bytes() == b"older"
    assert list(tmp_path.iterdir()) == [path]
