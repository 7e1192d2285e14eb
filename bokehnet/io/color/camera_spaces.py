"""Colour spaces of cameras, film scans and compositing, which files rarely name: for ``--input-color-space``.

Each is a logarithmic curve, or linear light, with the primaries of the same document.
"""

import math

from bokehnet.io.color.color_space import (
    COLOR_SPACES,
    LINEAR_REC709,
    REC709,
    ColorSpace,
    space_of_chromaticities,
)
from bokehnet.io.color.transfer import LINEAR, Curve

__all__ = ["CINEON", "INPUT_COLOR_SPACES"]

_D65, _ACES_WHITE = (0.3127, 0.3290), (0.32168, 0.33767)

# Kodak, "Conversion of 10-bit log film data to 8-bit linear or video data", 1995: 0.002 density per code
# value, negative gamma 0.6, white at 685, black at 95. Below black, the tangent continues. Film has no
# primaries of a display: Rec. 709.
_CODES = 1023
_WHITE, _BLACK, _CODES_PER_DECADE = 685 / _CODES, 95 / _CODES, 0.6 / 0.002
_FLARE = 10 ** ((_BLACK - _WHITE) * _CODES / _CODES_PER_DECADE)
_DECADE = _CODES_PER_DECADE / _CODES
_CINEON = Curve(
    "log",
    (0.0, 1 - _FLARE, _FLARE, _DECADE, _WHITE, _DECADE * (1 - _FLARE) / (_FLARE * math.log(10)), _BLACK),
)
# ARRI, "ALEXA Log C curve: usage in VFX", 2017: table of SUP 3.x for exposure index 800, and the wide gamut.
_LOG_C = Curve("log", (0.010591, 5.555556, 0.052272, 0.247190, 0.385537, 5.367655, 0.092809))
_ARRI_WIDE = ((0.6840, 0.3130), (0.2210, 0.8480), (0.0861, -0.1020), _D65)
# Sony, "Technical summary for S-Gamut3.Cine/S-Log3 and S-Gamut3/S-Log3", 2014.
_S_LOG3_SLOPE = (171.2102946929 - 95) / 0.01125 / _CODES
_S_LOG3 = Curve(
    "log", (0.01125, 1 / 0.19, 0.01 / 0.19, 261.5 / _CODES, 420 / _CODES, _S_LOG3_SLOPE, 95 / _CODES)
)
_S_GAMUT3 = ((0.730, 0.280), (0.140, 0.855), (0.100, -0.050), _D65)
_S_GAMUT3_CINE = ((0.766, 0.275), (0.225, 0.800), (0.089, -0.087), _D65)
# Panasonic, "V-Log/V-Gamut reference manual", 2014.
_V_LOG = Curve("log", (0.01, 1.0, 0.00873, 0.241514, 0.598206, 5.6, 0.125))
_V_GAMUT = ((0.730, 0.280), (0.165, 0.840), (0.100, -0.030), _D65)
# Academy S-2016-001, "ACEScct - A quasi-logarithmic encoding of ACES data", 2016.
_OCTAVES = 17.52
_ACES_CCT = Curve(
    "log",
    (
        0.0078125,
        1.0,
        0.0,
        1 / (math.log10(2) * _OCTAVES),
        9.72 / _OCTAVES,
        10.5402377416545,
        0.0729055341958355,
    ),
)
# SMPTE ST 2065-1, "Academy Color Encoding Specification", 2012, for AP0; Academy S-2014-004, "ACEScg", 2014,
# for AP1.
_AP0 = ((0.7347, 0.2653), (0.0, 1.0), (0.0001, -0.0770), _ACES_WHITE)
_AP1 = ((0.713, 0.293), (0.165, 0.830), (0.128, 0.044), _ACES_WHITE)

CINEON = space_of_chromaticities("Cineon film log", REC709, _CINEON)

INPUT_COLOR_SPACES: dict[str, ColorSpace] = {
    **COLOR_SPACES,
    "linear": LINEAR_REC709,
    "aces2065-1": space_of_chromaticities("ACES2065-1", _AP0, LINEAR),
    "acescg": space_of_chromaticities("ACEScg", _AP1, LINEAR),
    "acescct": space_of_chromaticities("ACEScct", _AP1, _ACES_CCT),
    "logc3": space_of_chromaticities("ARRI LogC3 (EI 800)", _ARRI_WIDE, _LOG_C),
    "slog3": space_of_chromaticities("S-Log3 S-Gamut3", _S_GAMUT3, _S_LOG3),
    "slog3-cine": space_of_chromaticities("S-Log3 S-Gamut3.Cine", _S_GAMUT3_CINE, _S_LOG3),
    "vlog": space_of_chromaticities("V-Log V-Gamut", _V_GAMUT, _V_LOG),
    "cineon": CINEON,
}
