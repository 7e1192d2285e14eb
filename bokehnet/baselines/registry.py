"""The methods by name, and each of them as an engine calls it."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from importlib import import_module

import numpy as np

from bokehnet.checks import check_choice
from bokehnet.classical.base import ClassicalRenderer, ClassicalResult, Place, Strip
from bokehnet.classical.error_map import geometric_error_map
from bokehnet.classical.known_surfaces import KnownSurfaces
from bokehnet.errors import ParameterError
from bokehnet.optics.aperture import Aperture
from bokehnet.optics.lens_response import LensResponse
from bokehnet.optics.pixel_filter import DEFAULT_FILTER, PixelFilter

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

BASELINES = {
    "gather_basic": Baseline(
        module="bokehnet.baselines.basic_gather",
        paper="thesis 004",
        openings="outline",
        faults=f"noise; sharp surroundings bleed into the blur; {_LEAK}",
    ),
    "gather_spiral": Baseline(
        module="bokehnet.baselines.spiral_gather",
        paper="Gustafsson 2018",
        openings="outline",
        faults="the running mean weighs rings unevenly; the foreground stays visible inside its own blur",
    ),
    "gather_bokeh": Baseline(
        module="bokehnet.baselines.bokeh_gather",
        paper="thesis 004",
        openings="cats-eye",
        faults="halos: a background is less blurred near a foreground; a pattern where samples are few",
    ),
    "gather_passes": Baseline(
        module="bokehnet.baselines.multi_pass_gather",
        paper="thesis 004",
        openings="outline",
        faults="half resolution near focus; no order within the near and the far plane",
    ),
    "jimenez": Baseline(
        module="bokehnet.baselines.scatter_as_you_gather",
        paper="Jimenez 2014",
        openings="outline",
        faults="few taps: blotches and tiles; two layers a tile; bright lights lose energy",
    ),
    "tan": Baseline(
        module="bokehnet.baselines.scatter_as_you_gather",
        paper="Tan 2022",
        openings="outline",
        faults="its normalisation cancels the two layers: a scatter at 81 taps",
    ),
    "abadie": Baseline(
        module="bokehnet.baselines.layered_gather",
        paper="Abadie 2018",
        openings="outline",
        faults="half resolution; backgrounds filled in by mirrored taps; lights chosen by a threshold",
    ),
    "diffusion": Baseline(
        module="bokehnet.baselines.heat_diffusion",
        paper="Kass 2006",
        openings="disc",
        faults=f"Gaussian blur, no discs; {_LEAK}",
    ),
    "overlap": Baseline(
        module="bokehnet.baselines.overlap_filter",
        paper="Zhou 2007",
        openings="disc",
        faults=f"square blur; streaks, as rows and columns are filtered one after the other; {_BLIND}",
    ),
    "low_rank": Baseline(
        module="bokehnet.baselines.low_rank_filter",
        paper="McGraw 2014",
        openings="any",
        faults=f"rings of cut ranks, light below 0 included; {_BLIND}",
    ),
    "lommel": Baseline(
        module="bokehnet.baselines.lommel_spots",
        paper="Potmesil and Chakravarty 1981",
        openings="disc",
        faults=f"monochromatic rings; {_BLIND}",
    ),
    "rectangle": Baseline(
        module="bokehnet.baselines.spreading",
        paper="Kosloff 2009",
        openings="disc",
        faults=f"square blur; {_BLIND}",
    ),
    "perimeter": Baseline(
        module="bokehnet.baselines.spreading",
        paper="Kosloff 2009",
        openings="any",
        faults=_BLIND,
    ),
    "hybrid_spreading": Baseline(
        module="bokehnet.baselines.spreading",
        paper="Kosloff 2010",
        openings="any",
        faults=f"square blur where contrast is low; {_BLIND}",
    ),
    "bokehme_scatter": Baseline(
        module="bokehnet.baselines.bokehme",
        paper="Peng 2022",
        openings="disc",
        faults=_BLIND,
    ),
}


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
        strip: Strip | None = None,
        lens_response: LensResponse | None = None,
        place: Place | None = None,
        progress: Callable[[float], None] | None = None,
        pixel_filter: PixelFilter = DEFAULT_FILTER,
        known: KnownSurfaces | None = None,
        rays_share: float = 1.0,
    ) -> ClassicalResult:
        if (
            lens_response is not None
            and not replace(
                lens_response, aberration_map=lens_response.aberration_map.without_tilt()
            ).is_plain
        ):
            expected = "one that knows aberrations, rims and fringes of a lens"
            raise ParameterError("engine", expected, name, "use the engine `rays` or `hybrid`")
        assert strip is None  # the engine refuses to cut
        where = {"place": place} if BASELINES[name].openings == "cats-eye" else {}
        bokeh = method(image, defocus, aperture, **where)
        if progress is not None:
            progress(0.9)
        return ClassicalResult(bokeh=bokeh, error_map=geometric_error_map(defocus))

    return render
