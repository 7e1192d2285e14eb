"""Resolution multiplier of thesis 004: ``python -m benchmarks.experiments.theses.camera_effects``.

Time of the spiral gather, and its agreement with full resolution, by multiplier. ``--figures DIR`` writes
JSON.
"""

from time import process_time

import numpy as np

from benchmarks.experiments.theses.bokehlab import report
from bokehnet.baselines import gather_spiral
from train.scores.metrics import encode, psnr

_COMMAND = "python -m benchmarks.experiments.theses.camera_effects --figures docs/figures"


def resolutions() -> dict[str, dict[str, float]]:
    """Return seconds and PSNR against twice the resolution, blurred and in focus, by multiplier."""
    rng = np.random.default_rng(0)
    y, x = np.mgrid[:360, :640]
    image = 0.5 + 0.4 * np.sin(x / 3.7)[..., None] * np.sin(y[..., None] / 5.1 + np.arange(3))
    image = (image + 0.1 * rng.random(image.shape)).astype(np.float32)
    defocus = np.where(x < 320, 0.0, 12.0).astype(np.float32)
    gather_spiral(image[:32, :32], defocus[:32, -32:])
    truth = encode(gather_spiral(image, defocus, resolution=2.0))
    rows = {}
    for resolution in (0.35, 0.5, 0.71, 1.0, 1.41):
        start = process_time()
        encoded = encode(gather_spiral(image, defocus, resolution=resolution))
        seconds, squared = process_time() - start, (encoded - truth) ** 2
        rows[f"multiplier {resolution:g}"] = {
            "seconds": seconds,
            "sharp": psnr(squared[:, :300]),
            "blurred": psnr(squared[:, 340:]),
        }
    return rows


_MEASUREMENTS = {
    "camera_resolution": (
        resolutions,
        "spiral gather, 640x360 pixels, half of it blurred by 12 px; PSNR against multiplier 2",
        {
            "seconds": ("processor seconds", ".2f"),
            "sharp": ("PSNR in focus", ".1f"),
            "blurred": ("PSNR blurred", ".1f"),
        },
    )
}


def main() -> None:
    """Entry of the command line."""
    report(_MEASUREMENTS, _COMMAND, __doc__)


if __name__ == "__main__":
    main()
