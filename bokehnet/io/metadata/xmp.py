"""XMP metadata: assemble packets from the segments of a JPEG, and parse untrusted packets safely.

The parser is the standard library's expat, with every document type declaration refused: without one there
are no entities, hence neither expansion bombs nor references to other files, and no dependency is needed.
"""

import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from xml.etree.ElementTree import Element, TreeBuilder
from xml.parsers import expat

from bokehnet.errors import ImageFileError

__all__ = ["STANDARD_XMP", "jpeg_xmp", "parse_xmp", "refreshed_xmp", "xmp_properties"]

STANDARD_XMP = b"http://ns.adobe.com/xap/1.0/\0"
_EXTENDED = b"http://ns.adobe.com/xmp/extension/\0"
_NOTE = "http://ns.adobe.com/xmp/note/"
_GUID = 32  # characters of the GUID of an extended packet; its length and the offset of this piece follow
_HEAD = _GUID + 8
_MAX_NESTING = 100  # nested elements; real packets have about ten

# Upper bounds of a packet: bytes, and numbers of tags, attributes and declared namespaces.
_MAX_BYTES, _MAX_TAGS, _MAX_ATTRIBUTES, _MAX_NAMESPACES = 2**27, 200_000, 100_000, 1000
_MAX_PACKETS = 4  # per picture; the specification allows one

# Namespace prefixes of depth, gain maps, videos and originals that accompany a picture, and of the extended
# packet that holds some of them: none of them matches a blurred picture.
_ACCOMPANYING = (
    *(f"http://ns.google.com/photos/1.0/{name}/" for name in ("depthmap", "image", "focus", "container")),
    "http://ns.google.com/photos/1.0/camera/",
    "http://ns.google.com/photos/dd/",
    "http://ns.adobe.com/hdr-gain-map/",
    "http://ns.apple.com/HDRGainMap/",
    "http://ns.apple.com/HDRToneMap/",
    "http://ns.apple.com/pixeldatainfo/",
    "http://ns.apple.com/depthData/",
    _NOTE,
)
_THUMBNAILS = "{http://ns.adobe.com/xap/1.0/}Thumbnails"
_DECLARED = re.compile(r"""xmlns:([\w.-]+)\s*=\s*["']([^"']*)["']""")
_ORIENTATION = re.compile(rb"""(tiff:Orientation\s*(?:=\s*["']|>\s*))[2-8]""")


def jpeg_xmp(path: Path | str, app1: Sequence[bytes]) -> list[Element]:
    """Return the parsed standard packet of a picture and its extended packet; empty if there is none.

    Args:
        path: File, for messages.
        app1: Payloads of its APP1 segments.

    Raises:
        ImageFileError: A packet is damaged, or pieces of the extended one are missing.

    Source: Adobe, "XMP specification part 3: Storage in files", 2020, 1.1.3: Embedding XMP in JPEG.
    """
    standard = [payload[len(STANDARD_XMP) :] for payload in app1 if payload.startswith(STANDARD_XMP)]
    packets = [parse_xmp(path, packet) for packet in standard[:_MAX_PACKETS]]
    names = [xmp_properties([root], _NOTE).get("HasExtendedXMP") for root in packets]
    pieces = [payload[len(_EXTENDED) :] for payload in app1 if payload.startswith(_EXTENDED)]
    for name in dict.fromkeys(name for name in names if name):
        own = [piece for piece in pieces if piece[:_GUID].lower() == name.lower().encode()]
        if own:  # otherwise an editor has dropped it
            packets.append(parse_xmp(path, _join_pieces(path, own)))
    return packets


def parse_xmp(path: Path | str, packet: bytes) -> Element:
    """Parse one packet; names have the form ``{namespace}name``.

    Args:
        path: File, for messages.
        packet: XML, with or without its ``xpacket`` frame and padding.

    Raises:
        ImageFileError: The packet is not well-formed, declares a document type, is nested too deeply, or has
            more elements or attributes than any program writes.
    """
    _check_size(path, packet)
    builder, parser = TreeBuilder(), expat.ParserCreate(namespace_separator="}")
    depth = 0

    def start(name: str, attributes: dict[str, str]) -> None:
        nonlocal depth
        depth += 1
        if depth > _MAX_NESTING:
            raise ImageFileError(f"{path}: the XMP metadata is nested deeper than {_MAX_NESTING} elements")
        builder.start(_qualified(name), {_qualified(key): value for key, value in attributes.items()})

    def end(name: str) -> None:
        nonlocal depth
        depth -= 1
        builder.end(_qualified(name))

    def refuse(*_: object) -> None:
        raise ImageFileError(f"{path}: the XMP metadata declares a document type, which is refused")

    parser.buffer_text = True
    parser.StartElementHandler = start
    parser.EndElementHandler = end
    parser.CharacterDataHandler = builder.data
    parser.StartDoctypeDeclHandler = refuse
    try:
        parser.Parse(packet.strip(b"\0 \t\r\n"), True)
    except (expat.ExpatError, LookupError, ValueError) as error:  # the latter two: unknown encoding
        raise ImageFileError(f"{path}: the XMP metadata is damaged ({error})") from error
    return builder.close()


def _check_size(path: Path | str, packet: bytes) -> None:
    """Raise if a packet exceeds an upper bound; the counts are at least those of the parser."""
    if len(packet) > _MAX_BYTES:
        raise ImageFileError(
            f"{path}: expected at most {_MAX_BYTES} bytes of XMP metadata, found {len(packet)}"
        )
    for what, mark, max_count in (
        ("tags", b"<", _MAX_TAGS),
        ("attributes", b"=", _MAX_ATTRIBUTES),
        ("namespaces", b"xmlns", _MAX_NAMESPACES),
    ):
        count = packet.count(mark)
        if count > max_count:
            raise ImageFileError(
                f"{path}: expected at most {max_count} {what} in the XMP metadata, found {count}"
            )


def xmp_properties(roots: Iterable[Element], namespace: str) -> dict[str, str]:
    """Return the simple properties of a namespace, written as attributes or elements; the first one counts.

    Args:
        roots: Elements to search, at any depth.
        namespace: URI of the namespace.

    Returns:
        Text by name without the namespace.
    """
    prefix = f"{{{namespace}}}"
    properties: dict[str, str] = {}
    for root in roots:
        for element in root.iter():
            written = list(element.attrib.items())
            if not len(element) and element.text:
                written.append((element.tag, element.text))
            for name, text in written:
                if name.startswith(prefix):
                    properties.setdefault(name.removeprefix(prefix), text.strip())
    return properties


def refreshed_xmp(path: Path | str, packet: bytes) -> tuple[bytes, bool]:
    """Return a packet for the upright, blurred version of its picture, and whether it announced maps.

    The orientation becomes 1. Depth, gain maps, accompanying pictures and thumbnails are removed; a packet
    without these remains otherwise unchanged.

    Args:
        path: File, for messages.
        packet: Packet as stored.

    Raises:
        ImageFileError: As for :func:`parse_xmp`, if the packet must be parsed.
    """
    packet = _ORIENTATION.sub(rb"\g<1>1", packet)
    maps = any(start.encode() in packet for start in _ACCOMPANYING)
    if not maps and b"Thumbnails" not in packet:
        return packet, False
    root = parse_xmp(path, packet)
    _strip(root)
    declared = dict(_DECLARED.findall(packet.decode("utf-8", "replace")))
    prefixes = {uri: prefix for prefix, uri in declared.items()}
    begin = "<?xpacket begin='\ufeff' id='W5M0MpCehiHzreSzNTczkc9d'?>\n"
    return f"{begin}{_serialise(root, prefixes)}\n<?xpacket end='w'?>".encode(), maps


def _strip(element: Element) -> None:
    for name in [name for name in element.attrib if name[1:].startswith(_ACCOMPANYING)]:
        del element.attrib[name]
    element[:] = [
        child
        for child in element
        if not (child.tag[1:].startswith(_ACCOMPANYING) or child.tag == _THUMBNAILS)
    ]
    for child in element:
        _strip(child)


def _serialise(root: Element, prefixes: Mapping[str, str]) -> str:
    """Return an element as text, with the original prefixes of its namespaces."""
    from xml.sax.saxutils import escape, quoteattr  # lazy: imports modules that access the network

    used = dict(prefixes)

    def short(name: str) -> str:
        uri, _, local = name[1:].rpartition("}")
        if not name.startswith("{"):
            return name
        if uri == "http://www.w3.org/XML/1998/namespace":
            return f"xml:{local}"
        return f"{used.setdefault(uri, f'ns{len(used)}')}:{local}"

    def text_of(element: Element) -> str:
        tag = short(element.tag)
        attributes = "".join(f" {short(name)}={quoteattr(text)}" for name, text in element.attrib.items())
        content = escape(element.text or "") + "".join(
            text_of(child) + escape(child.tail or "") for child in element
        )
        return f"<{tag}{attributes}>{content}</{tag}>"

    body = text_of(root)
    tag = short(root.tag)
    declared = "".join(
        f" xmlns:{prefix}={quoteattr(uri)}"
        for uri, prefix in used.items()
        if not uri.startswith(_ACCOMPANYING)
    )
    return f"<{tag}{declared}{body[1 + len(tag) :]}"


def _join_pieces(path: Path | str, pieces: list[bytes]) -> bytes:
    """Join the pieces of an extended packet, which may come in any order."""
    if any(len(piece) < _HEAD for piece in pieces):
        raise ImageFileError(f"{path}: a piece of the extended XMP metadata is cut short")
    total = int.from_bytes(pieces[0][_GUID : _GUID + 4], "big")
    parts, length = [], 0
    for piece in sorted(pieces, key=_offset):
        if _offset(piece) != length:
            raise ImageFileError(f"{path}: the extended XMP metadata has a gap or overlap at byte {length}")
        parts.append(piece[_HEAD:])
        length += len(parts[-1])
    if length != total:
        raise ImageFileError(
            f"{path}: expected {total} bytes of extended XMP metadata, found {length}; copy the photo again"
        )
    return b"".join(parts)


def _offset(piece: bytes) -> int:
    return int.from_bytes(piece[_GUID + 4 : _HEAD], "big")


def _qualified(name: str) -> str:
    return "{" + name if "}" in name else name
