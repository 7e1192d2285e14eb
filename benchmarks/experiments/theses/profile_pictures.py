"""Profile textures against the traced lens: ``python -m benchmarks.experiments.theses.profile_pictures``.

Thesis 002, 5.2: every blur is that of a point on the axis. Pictures through lenses of the catalog, traced
through the glass (:mod:`benchmarks.experiments.lenses.lens_pictures`), by methods that know the lens to a
different degree. ``--figures DIR`` writes the table as a JSON file.
"""

from collections.abc import Callable
from functools import partial
from time import process_time

import numpy as np

from benchmarks.experiments.lenses.lens_pictures import LensCase, score, trace_case
from benchmarks.experiments.theses.bokehlab import report
from bokehnet.baselines.spread.lens_tables import lens_spreading
from bokehnet.baselines.spread.profile_spreading import profile_spreading, texture_spreading
from bokehnet.classical.rays_renderer import rays
from bokehnet.lenses.aberrations.aberration_fit import fit_aberration_map
from bokehnet.lenses.lookup.profile_texture import trace_profile_texture
from bokehnet.optics.aberrations.lens_response import LensResponse

_COMMAND = "python -m benchmarks.experiments.theses.profile_pictures --figures docs/figures"

_LENSES, _SIZE, _SAMPLES = ("biconvex", "double_gauss", "petzval"), (320, 240), 3


def _ways(case: LensCase) -> dict[str, Callable[[], np.ndarray]]:
    """Return the methods by label; the lens is prepared here, outside the measured time."""
    options = (case.image, case.defocus)
    aberrations = fit_aberration_map(case.lens)
    response, profile = (LensResponse(aberration_map=each) for each in (aberrations, aberrations.on_axis()))
    textured = partial(
        texture_spreading, *options, trace_profile_texture(case.lens), case.lens, case.pixel_pitch
    )
    return {
        "spreading, perfect lens": partial(lens_spreading, *options),
        "profile texture, mapping (5.6) to (5.9)": partial(textured, mapping="printed"),
        "profile texture, our mapping": textured,
        "`profile_spreading`, profiles of the map": partial(
            profile_spreading, *options, lens_response=response
        ),
        "`lens_spreading`, aberration map": partial(lens_spreading, *options, lens_response=response),
        "`rays`, profile (`--lens-engine profile`)": partial(rays, *options, lens_response=profile),
        "`rays`, aberration map": partial(rays, *options, lens_response=response),
    }


def pictures() -> dict[str, dict[str, float]]:
    """Return PSNR and processor seconds of each method for each lens."""
    rows = {}
    for name in _LENSES:
        case = trace_case(name, _SIZE, _SAMPLES)
        for label, render in _ways(case).items():
            render()  # compiles
            start = process_time()
            picture = render()
            seconds = process_time() - start
            inner, everywhere = score(picture, case.truth, case.inner)
            rows[f"{name}: {label}"] = {"inner": inner, "all": everywhere, "seconds": seconds}
        rows[f"{name}: noise of the truth"] = {"inner": case.noise[0], "all": case.noise[1], "seconds": 0.0}
    return rows


_MEASUREMENTS = {
    "jeong_pictures": (
        pictures,
        "320x240 pixels, against pictures traced through the glass; inner: out of reach of depth edges; "
        "processor seconds",
        {"inner": ("PSNR inner", ".2f"), "all": ("PSNR", ".2f"), "seconds": ("seconds", ".2f")},
    )
}


def main() -> None:
    """Entry of the command line."""
    report(_MEASUREMENTS, _COMMAND, __doc__)


if __name__ == "__main__":
    main()
