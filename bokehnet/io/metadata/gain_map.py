"""Gain maps: brightness beyond white that phones store beside an 8-bit picture."""

from pathlib import Path

__all__ = ["gain_map_kind"]

# Names of gain maps in files, most specific first. Sources: ISO 21496-1, 2025, annex C; Adobe, "Gain map
# specification", 2023; Apple, "Applying Apple HDR effect to your photos", 2023; AOM, "AVIF specification",
# 2024, for the item type of ISO gain maps in HEIF.
_NAMES = {
    b"urn:iso:std:iso:ts:21496:-1": "ISO 21496-1",
    b"http://ns.adobe.com/hdr-gain-map/1.0/": "Ultra HDR",
    b"urn:com:apple:photo:2020:aux:hdrgainmap": "Apple HDR",
    b"http://ns.apple.com/HDRGainMap/1.0/": "Apple HDR",
}


def gain_map_kind(path: Path | str) -> str:
    """Return the kind of the gain map in a JPEG or HEIF file; empty if there is none.

    The file is searched for the names of gain maps, which are stored uncompressed.

    Args:
        path: Readable file.

    Examples:
        >>> _ = Path("plain.jpg").write_bytes(bytes(100))
        >>> gain_map_kind("plain.jpg")
        ''
    """
    data = Path(path).read_bytes()
    return next((kind for name, kind in _NAMES.items() if name in data), "")
