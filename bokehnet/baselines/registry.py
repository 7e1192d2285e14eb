"""The methods by name, and each of them as an engine calls it."""

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from typing import Any, Unpack

import numpy as np

from bokehnet.checks import check_choice
from bokehnet.classical.base import (
    ClassicalOptions,
    ClassicalRenderer,
    ClassicalResult,
    check_ideal_except_tilt,
)
from bokehnet.classical.error_map import geometric_error_map
from bokehnet.optics.aperture import Aperture

__all__ = ["BASELINES", "Baseline", "baseline_renderer"]


@dataclass(frozen=True, kw_only=True, slots=True)
class Baseline:
    """A method of the literature.

    Attributes:
        module: Where the function of its name stands.
        paper: Authors and year.
        openings: Which apertures it knows: ``disc``, ``outline`` (any without a hole, evenly lit), ``any``;
            and ``cats-eye``, outlines that the lens barrel clips.
        faults: What is known to be wrong with it, in a line.
    """

    module: str
    paper: str
    openings: str
    faults: str


_LEAK = "sharp outlines of blurred foregrounds"
_BLIND = "foreground and background mix without order"

# Name, file in this folder, openings and paper of each.
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
lens_spreading    spread.lens_tables            any       thesis 001
image_rays        rays.image_based_rays         any       Lee 2010
bokehme_scatter   spread.bokehme                disc      Peng 2022
"""

# Those that know what a lens does beyond focusing.
_KNOW_LENSES = ("lens_spreading",)

_FAULTS = {
    "gather_basic": f"noise; sharp surroundings bleed into the blur; {_LEAK}",
    "gather_spiral": "the running mean weighs rings unevenly; a foreground stays visible in its own blur",
    "gather_bokeh": "halos: a background is less blurred near a foreground; a pattern where samples are few",
    "gather_passes": "half resolution near focus; no order within the near and the far plane",
    "jimenez": "few taps: blotches and tiles; two layers a tile; bright lights lose energy",
    "tan": "its normalisation cancels the two layers: a scatter at 81 taps",
    "abadie": "half resolution; backgrounds filled in by mirrored taps; lights chosen by a threshold",
    "diffusion": f"Gaussian blur, no discs; {_LEAK}",
    "overlap": f"square blur; streaks, as rows and columns are filtered one after the other; {_BLIND}",
    "low_rank": f"rings of cut ranks, light below 0 included; {_BLIND}",
    "lommel": f"monochromatic rings; {_BLIND}",
    "rectangle": f"square blur; {_BLIND}",
    "perimeter": _BLIND,
    "hybrid_spreading": f"square blur where contrast is low; {_BLIND}",
    "lens_spreading": f"slow; {_BLIND}",
    "image_rays": "foregrounds keep their outline unless layers are given; edges in steps of pixels; noise",
    "bokehme_scatter": _BLIND,
}


def _table() -> dict[str, Baseline]:
    rows = (line.split(maxsplit=3) for line in _METHODS.strip().splitlines())
    return {
        name: Baseline(
            module=f"bokehnet.baselines.{file}", paper=paper, openings=openings, faults=_FAULTS[name]
        )
        for name, file, openings, paper in rows
    }


BASELINES = _table()


def baseline_renderer(name: str) -> ClassicalRenderer:
    """Return a baseline as engines call their classical half, with the geometric error map beside it.

    Raises:
        ParameterError: Unknown name. The renderer raises it for lenses, strips and openings that the method
            does not know.
    """
    check_choice("engine", name, BASELINES)
    method: Callable[..., np.ndarray] = getattr(import_module(BASELINES[name].module), name)

    def render(
        image: np.ndarray,
        defocus: np.ndarray,
        aperture: Aperture | None = None,
        **options: Unpack[ClassicalOptions],
    ) -> ClassicalResult:
        where: dict[str, Any] = {}
        if name in _KNOW_LENSES:
            where["lens_response"] = options.get("lens_response")
        else:
            check_ideal_except_tilt(options.get("lens_response"), name)
        assert options.get("strip") is None  # the engine refuses to cut
        if BASELINES[name].openings == "cats-eye":
            where["place"] = options.get("place")
        bokeh = method(image, defocus, aperture, **where)
        progress = options.get("progress")
        if progress is not None:
            progress(0.9)
        return ClassicalResult(bokeh=bokeh, error_map=geometric_error_map(defocus))

    return render
