"""One lens of ours in every format: a cemented doublet with an asphere, in inches where the format has units.

50 mm in front of it stands the stop; f/5, half an angle of 5 degrees.
"""

ZMX = """\
VERS 140124 258 36214
MODE SEQ
NAME Doublet
UNIT IN X W X CM MR CPMM
ENPD 0.8
GCAT SCHOTT
FTYP 0 0 2 1 0 0 0
XFLN 0 0 0
YFLN 0 5 0
WAVM 1 4.861E-1 1
WAVM 2 5.875618E-1 1
PWAV 2
SURF 0
  TYPE STANDARD
  CURV 0.0
  DISZ INFINITY
SURF 1
  COMM iris
  STOP
  TYPE STANDARD
  CURV 0.0
  DISZ 0.2
SURF 2
  TYPE EVENASPH
  CURV 0.4
  CONI -0.5
  PARM 2 0.002
  DISZ 0.25
  GLAS N-BK7 0 0 1.5 40 0
  DIAM 0.6 1 0 0 1 ""
SURF 3
  TYPE STANDARD
  CURV -0.35
  DISZ 0.1
  GLAS ___BLANK 1 0 1.62 36.3 0
  DIAM 0.6 1 0 0 1 ""
SURF 4
  TYPE STANDARD
  CURV -0.1
  DISZ 3.8
SURF 5
  TYPE STANDARD
  CURV 0
  DISZ 0
"""

SEQ = """\
RDM N;LEN       "VERSION: 10.7"
TITLE 'Doublet'     ! of ours
EPD   0.8
DIM   I
WL    587.5618 486.1
REF   1
XAN   0.0 0.0
YAN   0.0 5.0
SO    0.0 0.1e14
S     0.0 0.2
  STO
  SLB "iris"
S     0.4 &
      0.25 NBK7_SCHOTT
  ASP
  K -0.5 ; A 0.002
  CIR 0.6
S     -0.35 0.1 1.62:36.3
  CIR 0.6
S     -0.1 3.8
SI    0.0 0.0
GO
"""

LEN = """\
// OSLO 6.5
LEN NEW "Doublet" 4 5
EBR 0.4
ANG 5.0
UNI 25.4
WV 0.5875618 0.4861
AIR
TH 1.0e20
NXT // 1
AIR
TH 0.2
AST
NXT // 2
GLA N-BK7
CV 0.4
TH 0.25
CC -0.5
AD 0.002
AP 0.6
NXT // 3
GLA MYFLINT 1.62 36.3
CV -0.35
TH 0.1
AP 0.6
NXT // 4
AIR
CV -0.1
TH 3.8
NXT // 5
AIR
TH 0.0
END 5
"""

_I = 25.4
CSV = f"""\
# name = Doublet
# epd = {0.8 * _I}
# field = 5
R, d, n, V, D, K, A4, glass
stop, {0.2 * _I}
{_I / 0.4}, {0.25 * _I}, 1.5168, 64.17, {1.2 * _I}, -0.5, {0.002 / _I**3}, N-BK7
{-_I / 0.35}, {0.1 * _I}, 1.62, 36.3, {1.2 * _I}
{-_I / 0.1}, {3.8 * _I}
"""


def _place(z, radius, glass, stop=False, shape="StandardGeometry", **more):
    system = {"x": 0.0, "y": 0.0, "z": z, "rx": 0.0, "ry": 0.0, "rz": 0.0, "reference_cs": None}
    return {
        "type": "Surface",
        "geometry": {"type": shape, "cs": system, "radius": radius, **more},
        "material_post": glass,
        "is_stop": stop,
        "aperture": None,
        "is_reflective": False,
    }


_AIR = {"type": "IdealMaterial", "index": 1.0}
_INFINITE = float("inf")
OPTILAND = {
    "version": 1.0,
    "name": "Doublet",
    "aperture": {"type": "EPD", "value": 0.8 * _I},
    "fields": {"fields": [{"x": 0.0, "y": 0.0}, {"x": 0.0, "y": 5.0}], "field_type": "angle"},
    "wavelengths": {"wavelengths": [{"value": 0.5875618, "is_primary": True, "unit": "um"}]},
    "surface_group": {
        "surfaces": [
            _place(-_INFINITE, _INFINITE, _AIR, shape="Plane"),
            _place(0.0, _INFINITE, _AIR, stop=True, shape="Plane"),
            _place(
                0.2 * _I,
                _I / 0.4,
                {"type": "Material", "name": "N-BK7"},
                shape="EvenAsphere",
                conic=-0.5,
                coefficients=[0.0, 0.002 / _I**3],
            ),
            _place(0.45 * _I, -_I / 0.35, {"type": "AbbeMaterial", "index": 1.62, "abbe": 36.3}),
            _place(0.55 * _I, -_I / 0.1, _AIR),
            _place(4.35 * _I, _INFINITE, _AIR, shape="Plane"),
        ]
    },
}


def _ifc(curvature, number, **shape):
    kind = "EvenPolynomial" if shape else "Spherical"
    return {
        "__instance_type__": ["rayoptics.elem.surface", "Surface"],
        "attributes": {
            "interact_mode": "transmit",
            "max_aperture": 0.6,
            "label": "",
            "profile": {
                "__instance_type__": ["rayoptics.elem.profiles", kind],
                "attributes": {"cv": curvature, **shape},
            },
        },
    }


def _gap(thickness, module, kind, **message):
    medium = {"__instance_type__": [module, kind], "attributes": message}
    return {
        "__instance_type__": ["rayoptics.seq.gap", "Gap"],
        "attributes": {"thi": thickness, "medium": medium},
    }


def _holder(**message):
    return {"__instance_type__": ["", ""], "attributes": message}


_MEDIUM = "opticalglass.opticalmedium"
RAYOPTICS = {
    "optical_model": _holder(
        system_spec=_holder(title="Doublet", _dimensions="inches"),
        seq_model=_holder(
            ifcs=[
                _ifc(0.0, 0),
                _ifc(0.0, 1),
                _ifc(0.4, 2, cc=-0.5, coefs=[0.0, 0.002]),
                _ifc(-0.35, 3),
                _ifc(-0.1, 4),
                _ifc(0.0, 5),
            ],
            gaps=[
                _gap(1e10, _MEDIUM, "Air"),
                _gap(0.2, _MEDIUM, "Air"),
                _gap(0.25, "opticalglass.schott", "SchottGlass", gname="N-BK7"),
                _gap(0.1, "opticalglass.modelglass", "ModelGlass", n=1.62, v=36.3, label="flint"),
                _gap(3.8, _MEDIUM, "Air"),
            ],
            stop_surface=1,
        ),
        optical_spec=_holder(
            spectral_region=_holder(wavelengths=[486.1, 587.5618], reference_wvl=1),
            pupil=_holder(_key=["aperture", "object", "epd"], value=0.8),
            field_of_view=_holder(
                key=["field", "object", "angle"], fields=[_holder(x=0.0, y=0.0), _holder(x=0.0, y=5.0)]
            ),
        ),
    )
}
