"""Phone photos built byte by byte after the specifications, without the code under test."""

import base64
import hashlib
import io
import struct

import numpy as np
import pytest

RDF = 'xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#"'
GDEPTH = 'xmlns:GDepth="http://ns.google.com/photos/1.0/depthmap/"'
GFOCUS = 'xmlns:GFocus="http://ns.google.com/photos/1.0/focus/"'
GIMAGE = 'xmlns:GImage="http://ns.google.com/photos/1.0/image/"'
NOTE = 'xmlns:xmpNote="http://ns.adobe.com/xmp/note/"'
DYNAMIC = "".join(
    f' xmlns:{name}="http://ns.google.com/photos/dd/1.0/{name.lower()}/"'
    for name in ("Device", "Camera", "DepthMap", "Image")
)
APPLE = (
    'xmlns:apdi="http://ns.apple.com/pixeldatainfo/1.0/" xmlns:depthData="http://ns.apple.com/depthData/1.0/"'
)
STANDARD, EXTENDED = b"http://ns.adobe.com/xap/1.0/\0", b"http://ns.adobe.com/xmp/extension/\0"


def pillow():
    """Module ``PIL.Image``; skips the test that needs it where it is absent."""
    return pytest.importorskip("PIL.Image", reason="writes test files with Pillow")


def encode(array, form, **options):
    """A picture file; uint8 or uint16, grey or RGB."""
    stream = io.BytesIO()
    pillow().fromarray(array).save(stream, form, **options)
    return stream.getvalue()


def photo(array=None, orientation=None):
    """A JPEG with EXIF orientation."""
    array = np.full((24, 32, 3), 120, np.uint8) if array is None else array
    exif = pillow().Exif()
    if orientation:
        exif[0x0112] = orientation
    return encode(array, "JPEG", quality=95, exif=exif)


def packet(content):
    return (
        f'<?xpacket begin="\ufeff" id="W5M0MpCehiHzreSzNTczkc9d"?><x:xmpmeta xmlns:x="adobe:ns:meta/">'
        f'<rdf:RDF {RDF}>{content}</rdf:RDF></x:xmpmeta>   <?xpacket end="w"?>'
    ).encode()


def segment(payload):
    return b"\xff\xe1" + struct.pack(">H", len(payload) + 2) + payload


def with_segments(jpeg, *payloads):
    """Put APP1 payloads behind the start of a JPEG."""
    return jpeg[:2] + b"".join(segment(payload) for payload in payloads) + jpeg[2:]


def extended_payloads(content, size=60000, guid=None):
    guid = guid or hashlib.md5(content).hexdigest().upper()
    return guid, [
        EXTENDED + guid.encode() + struct.pack(">II", len(content), start) + content[start : start + size]
        for start in range(0, len(content), size)
    ]


def gdepth_attributes(near=None, far=None, units=None, form="RangeInverse", mime="image/png"):
    fields = {"Format": form, "Near": near, "Far": far, "Units": units, "Mime": mime}
    return " ".join(f'GDepth:{name}="{value}"' for name, value in fields.items() if value is not None)


def gdepth_photo(stored, *, original=None, focus=None, jpeg=None, **fields):
    """A photo with GDepth in its standard packet."""
    data = base64.b64encode(stored).decode()
    extra = "" if focus is None else f' GFocus:FocalDistance="{focus}"'
    if original is not None:
        extra += f' GImage:Mime="image/jpeg" GImage:Data="{base64.b64encode(original).decode()}"'
    attributes = f'{gdepth_attributes(**fields)} GDepth:Data="{data}"{extra}'
    body = f'<rdf:Description rdf:about="" {GDEPTH} {GFOCUS} {GIMAGE} {attributes}/>'
    return with_segments(jpeg or photo(), STANDARD + packet(body))


def extended_gdepth_photo(stored, *, size=60000, shuffle=False, drop=None, **fields):
    """A photo with GDepth whose data is in an extended packet of several segments."""
    data = base64.b64encode(stored).decode()
    guid, pieces = extended_payloads(
        packet(f'<rdf:Description rdf:about="" {GDEPTH} GDepth:Data="{data}"/>'), size
    )
    if shuffle:
        pieces.reverse()
    if drop is not None:
        del pieces[drop]
    body = (
        f'<rdf:Description rdf:about="" {GDEPTH} {NOTE} {gdepth_attributes(**fields)} '
        f'xmpNote:HasExtendedXMP="{guid}"/>'
    )
    return with_segments(photo(), STANDARD + packet(body), *pieces)


def directory(items, prefix="dd/1.0/"):
    """A Container:Directory; items are dicts of Item properties."""
    container = f"http://ns.google.com/photos/{prefix}container/"
    item = f"http://ns.google.com/photos/{prefix}item/" if "dd" in prefix else container + "item/"
    listed = "".join(
        '<rdf:li rdf:parseType="Resource"><Container:Item '
        + " ".join(f'Item:{name}="{value}"' for name, value in fields.items())
        + "/></rdf:li>"
        for fields in items
    )
    return (
        f'<rdf:Description rdf:about="" xmlns:Container="{container}" xmlns:Item="{item}">'
        f"<Container:Directory><rdf:Seq>{listed}</rdf:Seq></Container:Directory></rdf:Description>"
    )


def cameras(near, far, units="Meters", form="RangeInverse", uri="android/depthmap", original=None):
    """Device:Cameras with one camera, its properties as elements."""
    depth = {
        "ItemSemantic": "Depth",
        "Format": form,
        "Near": near,
        "Far": far,
        "Units": units,
        "DepthURI": uri,
    }
    fields = "".join(f"<DepthMap:{name}>{value}</DepthMap:{name}>" for name, value in depth.items())
    image = f'<Camera:Image Image:ItemSemantic="Original" Image:ItemURI="{original}"/>' if original else ""
    return (
        f'<rdf:Description rdf:about=""{DYNAMIC}><Device:Cameras><rdf:Seq><rdf:li rdf:parseType="Resource">'
        f'<Device:Camera rdf:parseType="Resource">{image}'
        f'<Camera:DepthMap rdf:parseType="Resource">{fields}</Camera:DepthMap>'
        f"</Device:Camera></rdf:li></rdf:Seq></Device:Cameras></rdf:Description>"
    )


def apple_xmp(low, high, kind="disparity", accuracy="relative"):
    return packet(
        f'<rdf:Description rdf:about="" {APPLE}><apdi:AuxiliaryImageType>{kind}</apdi:AuxiliaryImageType>'
        f"<apdi:FloatMinValue>{low}</apdi:FloatMinValue><apdi:FloatMaxValue>{high}</apdi:FloatMaxValue>"
        f"<depthData:Accuracy>{accuracy}</depthData:Accuracy></rdf:Description>"
    )


def _boxes(data, start, end):
    """ISO/IEC 14496-12: (type, content) of the boxes between two offsets."""
    while start < end:
        size, kind = struct.unpack(">I4s", data[start : start + 8])
        yield kind, data[start + 8 : start + size]
        start += size


def _box(kind, content):
    return struct.pack(">I4s", len(content) + 8, kind) + content


def _two_pictures(picture, grey):
    """The file type, the boxes of ``meta`` and the pixels of a HEIC file, and where these begin."""
    import pillow_heif

    pictures = pillow_heif.from_bytes(mode="RGB", size=picture.shape[1::-1], data=picture.tobytes())
    pictures.add_frombytes(mode="L", size=grey.shape[1::-1], data=grey.tobytes())
    stream = io.BytesIO()
    pictures.save(stream, quality=-1, chroma=444)
    data = stream.getvalue()
    top = dict(_boxes(data, 0, len(data)))
    meta = dict(_boxes(top[b"meta"], 4, len(top[b"meta"])))
    return top[b"ftyp"], meta, top[b"mdat"], len(data) - len(top[b"mdat"]) - 8


def _assembled(kind, meta, pixels, length):
    """A file of changed boxes; corrects the places of its pixels, and puts -1 where these end."""

    def head():
        inner = b"".join(_box(name, content) for name, content in meta.items())
        return _box(b"ftyp", kind) + _box(b"meta", bytes(4) + inner)

    start = len(head())
    # Version 0, 4-byte offsets, lengths and base offsets; each item has one extent.
    locations = bytearray(meta[b"iloc"])
    for at in range(18, len(locations), 18):
        (offset,) = struct.unpack(">I", locations[at : at + 4])
        moved = offset + start - length if offset != 0xFFFFFFFF else start + 8 + len(pixels) + 8
        locations[at : at + 4] = struct.pack(">I", moved)
    meta[b"iloc"] = bytes(locations)
    return head() + _box(b"mdat", pixels)


def heic_with_tone_map(picture, grey, metadata, inputs=(1, 2)):
    """A HEIC file with the hidden gain map of its picture (ISO/IEC 23008-12, amendment 1)."""
    kind, meta, pixels, length = _two_pictures(picture, grey)
    entries = list(_boxes(meta[b"iinf"], 6, len(meta[b"iinf"])))
    second = bytearray(entries[1][1])
    second[3] |= 1
    item = _box(b"infe", b"\2\0\0\0" + struct.pack(">HH4s", 3, 0, b"tmap") + b"\0")
    listed = _box(*entries[0]) + _box(b"infe", bytes(second)) + item
    meta[b"iinf"] = bytes(4) + struct.pack(">H", 3) + listed
    meta[b"iref"] = bytes(4) + _box(b"dimg", struct.pack(f">HH{len(inputs)}H", 3, len(inputs), *inputs))
    location = struct.pack(">HHIHII", 3, 0, 0, 1, 0xFFFFFFFF, len(metadata))
    meta[b"iloc"] = meta[b"iloc"][:6] + struct.pack(">H", 3) + meta[b"iloc"][8:] + location
    return _assembled(kind, meta, pixels, length) + _box(b"free", metadata)


def heic_with_auxiliary(picture, grey, auxiliary="urn:mpeg:hevc:2015:auxid:2", xmp=b""):
    """A HEIC file whose second picture is auxiliary to the first (ISO/IEC 23008-12, 6.5.8 and 6.6.2)."""
    kind_of_file, meta, pixels, length = _two_pictures(picture, grey)
    properties = dict(_boxes(meta[b"iprp"], 0, len(meta[b"iprp"])))
    count = len(list(_boxes(properties[b"ipco"], 0, len(properties[b"ipco"]))))
    kind = _box(b"auxC", bytes(4) + auxiliary.encode() + b"\0")
    # The associations of item 2 come last: one more of them, essential, to the new property.
    associations = bytearray(properties[b"ipma"] + bytes([0x80 | (count + 1)]))
    head = 8  # version, flags, number of items; then for each its number, a count, that many properties
    head += 3 + associations[head + 2]
    associations[head + 2] += 1
    meta[b"iprp"] = _box(b"ipco", properties[b"ipco"] + kind) + _box(b"ipma", bytes(associations))
    meta[b"iref"] = bytes(4) + _box(b"auxl", struct.pack(">HHH", 2, 1, 1))

    return _assembled(kind_of_file, meta, pixels, length) + (_box(b"free", xmp) if xmp else b"")
