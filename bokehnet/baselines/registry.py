"""Registry of the baselines, and their interface for engines."""

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from typing import TYPE_CHECKING, Any, Unpack

if TYPE_CHECKING:  # messages of the command line read the table without NumPy and numba
    import numpy as np

    from bokehnet.classical.base import ClassicalOptions, ClassicalRenderer, ClassicalResult
    from bokehnet.optics.aperture import Aperture

__all__ = ["BASELINES", "Baseline", "baseline_renderer"]


@dataclass(frozen=True, kw_only=True, slots=True)
class Baseline:
    """Method of the literature.

    Attributes:
        module: Module of the function of the same name.
        paper: Authors and year.
        apertures: Supported apertures: ``disc``, ``outline`` (uniform, without a hole), ``any``; and
            ``cats-eye``, outlines that the lens barrel clips.
        faults: Known faults in one line.
    """

    module: str
    paper: str
    apertures: str
    faults: str


_LEAK_FAULT = "sharp outlines of blurred foregrounds"
_ORDER_FAULT = "foreground and background mix without order"

# Name, file in this folder, apertures and paper of each.
_METHODS = """
gather_basic      gather.basic_gather           outline   thesis 004
gather_spiral     gather.spiral_gather          outline   Gustafsson 2018
gather_bokeh      gather.bokeh_gather           cats-eye  thesis 004
gather_passes     gather.multi_pass_gather      outline   thesis 004
jimenez           gather.scatter_as_you_gather  outline   Jimenez 2014
tan               gather.scatter_as_you_gather  outline   Tan 2022
abadie            gather.layered_gather         outline   Abadie 2018
diffusion         filters.heat_diffusion        disc      Kass 2006
overlap           filters.overlap_filter        disc      Zhou 2007
low_rank          filters.low_rank_filter       any       McGraw 2014
lommel            spread.lommel_spots           disc      Potmesil and Chakravarty 1981
rectangle         spread.spreading              disc      Kosloff 2009
perimeter         spread.spreading              any       Kosloff 2009
hybrid_spreading  spread.spreading              any       Kosloff 2010
spread_intervals  spread.layered_spreading      any       Kosloff 2009
spread_pixel_layers spread.layered_spreading    any       Lee 2008
lens_spreading    spread.lens_tables            any       thesis 001
profile_spreading spread.profile_spreading      disc      Jeong 2022
image_rays        rays.image_based_rays         any       Lee 2010
bokehme_scatter   spread.bokehme                disc      Peng 2022
bokehme           spread.bokehme                disc      Peng 2022
"""

# Baselines that support lens aberrations.
_WITH_LENS_RESPONSE = ("lens_spreading", "profile_spreading")

_FAULTS = {
    "gather_basic": f"noise; sharp surroundings bleed into the blur; {_LEAK_FAULT}",
    "gather_spiral": "the running mean weighs rings unevenly; a foreground stays visible in its own blur",
    "gather_bokeh": "halos: a background is less blurred near a foreground; a pattern where samples are few",
    "gather_passes": "half resolution near focus; no order within the near and the far plane",
    "jimenez": "few taps: blotches and tiles; two layers a tile; bright lights lose energy",
    "tan": "its normalisation cancels the two layers: a scatter at 81 taps",
    "abadie": "half resolution; backgrounds filled in by mirrored taps; lights chosen by a threshold",
    "diffusion": f"Gaussian blur, no discs; {_LEAK_FAULT}",
    "overlap": f"square blur; streaks, as rows and columns are filtered one after the other; {_ORDER_FAULT}",
    "low_rank": f"rings of cut ranks, light below 0 included; {_ORDER_FAULT}",
    "lommel": f"monochromatic rings; {_ORDER_FAULT}",
    "rectangle": f"square blur; {_ORDER_FAULT}",
    "perimeter": _ORDER_FAULT,
    "hybrid_spreading": f"square blur where contrast is low; {_ORDER_FAULT}",
    "spread_intervals": "holes behind foregrounds; seams where surfaces cross intervals",
    "spread_pixel_layers": "holes behind foregrounds; all surfaces on one side of a pixel mix",
    "lens_spreading": f"slow; {_ORDER_FAULT}",
    "profile_spreading": f"no cat's-eye, coma or lateral colour: the axis everywhere; {_ORDER_FAULT}",
    "image_rays": "foregrounds keep their outline unless layers are given; edges in steps of pixels; noise",
    "bokehme_scatter": _ORDER_FAULT,
    "bokehme": "its networks invent what is behind foregrounds; large blur is smooth at edges",
}


def _table() -> dict[str, Baseline]:
    rows = (line.split(maxsplit=3) for line in _METHODS.strip().splitlines())
    return {
        name: Baseline(
            module=f"bokehnet.baselines.{file}", paper=paper, apertures=apertures, faults=_FAULTS[name]
        )
        for name, file, apertures, paper in rows
    }


BASELINES = _table()


def baseline_renderer(name: str) -> "ClassicalRenderer":
    """Return a baseline as a classical renderer of an engine, with the geometric error map.

    Raises:
        ParameterError: Unknown name. The renderer raises it for lenses, strips and apertures that the method
            does not support.
    """
    from bokehnet.checks import check_choice
    from bokehnet.classical.base import ClassicalResult, check_ideal_except_tilt
    from bokehnet.classical.error_map import geometric_error_map

    check_choice("engine", name, BASELINES)
    method: Callable[..., np.ndarray] = getattr(import_module(BASELINES[name].module), name)

    def render(
        image: "np.ndarray",
        defocus: "np.ndarray",
        aperture: "Aperture | None" = None,
        **options: Unpack["ClassicalOptions"],
    ) -> "ClassicalResult":
        extra: dict[str, Any] = {}
        if name in _WITH_LENS_RESPONSE:
            extra["lens_response"] = options.get("lens_response")
        else:
            check_ideal_except_tilt(options.get("lens_response"), name)
        assert options.get("strip") is None  # the engine does not cut strips
        if BASELINES[name].apertures == "cats-eye":
            extra["viewport"] = options.get("viewport")
        bokeh = method(image, defocus, aperture, **extra)
        progress = options.get("progress")
        if progress is not None:
            progress(0.9)
        return ClassicalResult(bokeh=bokeh, error_map=geometric_error_map(defocus))

    return render
