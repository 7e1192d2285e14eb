"""XMP metadata: packets put together from the segments of a JPEG, parsed without trusting them.

The parser is the standard library's expat with every document type declaration refused: without one there
are no entities, so neither expansion bombs nor references to other files, and no package is needed for it.
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
_GUID = 32  # characters of the name of an extended packet, then its length and the offset of this piece
_HEAD = _GUID + 8
_DEEPEST = 100  # nested elements; real packets have about ten

# Beginnings of namespaces that tell of depth, gain maps, videos and originals beside a picture, and
# of the extended packet that holds some of them: none fits to a picture that was blurred.
_BESIDE = (
    *(f"http://ns.google.com/photos/1.0/{what}/" for what in ("depthmap", "image", "focus", "container")),
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
    """Return the standard packet of a picture and the extended one that it names, parsed; else nothing.

    Args:
        path: Of the file, for messages.
        app1: Payloads of its APP1 segments.

    Raises:
        ImageFileError: A packet is damaged, or pieces of the extended one are missing.

    Source: Adobe, "XMP specification part 3: Storage in files", 2020, 1.1.3: Embedding XMP in JPEG.
    """
    packets = [
        parse_xmp(path, payload[len(STANDARD_XMP) :]) for payload in app1 if payload.startswith(STANDARD_XMP)
    ]
    names = [xmp_properties([root], _NOTE).get("HasExtendedXMP") for root in packets]
    pieces = [payload[len(_EXTENDED) :] for payload in app1 if payload.startswith(_EXTENDED)]
    for name in dict.fromkeys(name for name in names if name):
        mine = [piece for piece in pieces if piece[:_GUID].lower() == name.lower().encode()]
        if mine:  # else an editor has dropped it
            packets.append(parse_xmp(path, _put_together(path, mine)))
    return packets


def parse_xmp(path: Path | str, packet: bytes) -> Element:
    """Parse one packet; names come as ``{namespace}name``.

    Args:
        path: Of the file, for messages.
        packet: XML, with or without its ``xpacket`` frame and padding.

    Raises:
        ImageFileError: It is not well-formed, declares a document type or is nested too deeply.
    """
    builder, parser = TreeBuilder(), expat.ParserCreate(namespace_separator="}")
    depth = 0

    def start(name: str, attributes: dict[str, str]) -> None:
        nonlocal depth
        depth += 1
        if depth > _DEEPEST:
            raise ImageFileError(f"{path}: the XMP metadata is nested deeper than {_DEEPEST} elements")
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
    except (expat.ExpatError, LookupError, ValueError) as error:  # the latter two: its encoding
        raise ImageFileError(f"{path}: the XMP metadata is damaged ({error})") from error
    return builder.close()


def xmp_properties(roots: Iterable[Element], namespace: str) -> dict[str, str]:
    """Collect simple properties of a namespace, written as attributes or as elements; the first one counts.

    Args:
        roots: Where to look, at any depth.
        namespace: Its URI.

    Returns:
        Text by name without the namespace.
    """
    prefix = f"{{{namespace}}}"
    found: dict[str, str] = {}
    for root in roots:
        for element in root.iter():
            written = list(element.attrib.items())
            if not len(element) and element.text:
                written.append((element.tag, element.text))
            for name, text in written:
                if name.startswith(prefix):
                    found.setdefault(name.removeprefix(prefix), text.strip())
    return found


def refreshed_xmp(path: Path | str, packet: bytes) -> tuple[bytes, bool]:
    """Return a packet for the upright, blurred twin of its picture, and whether maps were told of.

    The orientation becomes 1. What tells of depth, gain maps and other pictures beside it goes, thumbnails
    too; a packet that has none of these stays as it is otherwise.

    Args:
        path: Of the file, for messages.
        packet: As stored.

    Raises:
        ImageFileError: As :func:`parse_xmp`, where the packet has to be taken apart.
    """
    packet = _ORIENTATION.sub(rb"\g<1>1", packet)
    maps = any(start.encode() in packet for start in _BESIDE)
    if not maps and b"Thumbnails" not in packet:
        return packet, False
    root = parse_xmp(path, packet)
    _strip(root)
    declared = dict(_DECLARED.findall(packet.decode("utf-8", "replace")))
    prefixes = {uri: prefix for prefix, uri in declared.items()}
    begin = "<?xpacket begin='\ufeff' id='W5M0MpCehiHzreSzNTczkc9d'?>\n"
    return f"{begin}{_written(root, prefixes)}\n<?xpacket end='w'?>".encode(), maps


def _strip(element: Element) -> None:
    for name in [name for name in element.attrib if name[1:].startswith(_BESIDE)]:
        del element.attrib[name]
    for child in list(element):
        if child.tag[1:].startswith(_BESIDE) or child.tag == _THUMBNAILS:
            element.remove(child)
        else:
            _strip(child)


def _written(root: Element, prefixes: Mapping[str, str]) -> str:
    """An element as text, its namespaces under the prefixes that they had."""
    from xml.sax.saxutils import escape, quoteattr  # here: it loads what fetches files from the network

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
        inside = escape(element.text or "") + "".join(
            text_of(child) + escape(child.tail or "") for child in element
        )
        return f"<{tag}{attributes}>{inside}</{tag}>"

    body = text_of(root)
    tag = short(root.tag)
    declared = "".join(
        f" xmlns:{prefix}={quoteattr(uri)}" for uri, prefix in used.items() if not uri.startswith(_BESIDE)
    )
    return f"<{tag}{declared}{body[1 + len(tag) :]}"


def _put_together(path: Path | str, pieces: list[bytes]) -> bytes:
    """Join the pieces of an extended packet, which may come in any order."""
    if any(len(piece) < _HEAD for piece in pieces):
        raise ImageFileError(f"{path}: a piece of the extended XMP metadata is cut short")
    whole = int.from_bytes(pieces[0][_GUID : _GUID + 4], "big")
    parts, length = [], 0
    for piece in sorted(pieces, key=_offset):
        if _offset(piece) != length:
            raise ImageFileError(f"{path}: the extended XMP metadata has a gap or overlap at byte {length}")
        parts.append(piece[_HEAD:])
        length += len(parts[-1])
    if length != whole:
        raise ImageFileError(
            f"{path}: expected {whole} bytes of extended XMP metadata, found {length}; copy the photo again"
        )
    return b"".join(parts)


def _offset(piece: bytes) -> int:
    return int.from_bytes(piece[_GUID + 4 : _HEAD], "big")


def _qualified(name: str) -> str:
    return "{" + name if "}" in name else name
