"""Colour profiles made by hand, after ICC.1:2022 and ICC.1:2001-04: nothing of the code under test."""

import struct

import numpy as np

D50 = (0.9642, 1.0, 0.8249)


def xyz(values):
    return b"XYZ " + struct.pack(">4x3i", *(round(float(value) * 65536) for value in values))


def gamma(exponent):
    return b"curv" + struct.pack(">2IH", 0, 1, round(exponent * 256)) + b"\0\0"


def table(samples):
    fixed = [round(65535 * float(value)) for value in samples]
    return b"curv" + struct.pack(f">2I{len(fixed)}H", 0, len(fixed), *fixed)


def parametric(kind, *numbers):
    fixed = [round(number * 65536) for number in numbers]
    return b"para" + struct.pack(f">I2H{len(fixed)}i", 0, kind, 0, *fixed)


def named(text):
    return b"desc" + struct.pack(">2I", 0, len(text) + 1) + text.encode() + bytes(80)


def profile(model, tags, version=0x02400000):
    """A display profile of this colour model."""
    table_of_tags, body, start = b"", b"", 132 + 12 * len(tags)
    for name, content in tags.items():
        table_of_tags += struct.pack(">4s2I", name, start + len(body), len(content))
        body += content + bytes(-len(content) % 4)
    head = struct.pack(">I4xI4s4s4s", start + len(body), version, b"mntr", model, b"XYZ ")
    head += bytes(12) + b"acsp" + bytes(28) + struct.pack(">3i", *(round(v * 65536) for v in D50))
    return head.ljust(128, b"\0") + struct.pack(">I", len(tags)) + table_of_tags + body


def matrix_profile(columns, curves, name="test", **tags):
    """An RGB profile of three colorants, as seen under D50, and three curves."""
    content = {b"desc": named(name), b"wtpt": xyz(D50)}
    for letter, column, curve in zip("rgb", columns, curves, strict=True):
        content[f"{letter}XYZ".encode()], content[f"{letter}TRC".encode()] = xyz(column), curve
    return profile(b"RGB ", content | {key.encode(): value for key, value in tags.items()})


def grey_profile(curve):
    return profile(b"GRAY", {b"desc": named("grey"), b"wtpt": xyz(D50), b"kTRC": curve})


# Colorants of widely used profiles, as those files tell them.
ADOBE = ((0.60974, 0.31111, 0.01947), (0.20528, 0.62567, 0.06087), (0.14919, 0.06322, 0.74457))
P3 = ((0.51512, 0.2412, -0.00105), (0.29198, 0.69225, 0.04189), (0.1571, 0.06657, 0.78407))
PROPHOTO = ((0.79767, 0.28804, 0.0), (0.13519, 0.71188, 0.0), (0.03134, 0.00009, 0.82491))
SRGB_CURVE = parametric(3, 2.4, 1 / 1.055, 0.055 / 1.055, 1 / 12.92, 0.04045)

# As of a lab scanner: other curves for each colour, tabulated.
SCANNER = matrix_profile(
    ADOBE, [table(np.linspace(0, 1, 256) ** power) for power in (1.7, 1.9, 2.1)], "scanner"
)

KNOWN = {
    "adobe": matrix_profile(ADOBE, [gamma(563 / 256)] * 3, "Adobe RGB (1998)"),
    "p3": matrix_profile(P3, [SRGB_CURVE] * 3, "Display P3"),
    "prophoto": matrix_profile(PROPHOTO, [gamma(1.8)] * 3, "ProPhoto RGB"),
    "scanner": SCANNER,
    "offset": matrix_profile(P3, [parametric(4, 2.2, 0.9, 0.1, 0.2, 0.06, 0.0, 0.0)] * 3, "offset"),
    "sloped": matrix_profile(ADOBE, [parametric(1, 2.0, 1 / 1.1, 0.1 / 1.1)] * 3, "sloped"),
}
