"""The rays as a device follows them. Authority: the kernel for eight rays at once, on the CPU."""

import os
import subprocess
import sys

import numba
import numpy as np
import pytest

pytest.importorskip("torch", reason="needs the extra cuda")

from bokehnet.classical.cuda.march import cuda_rays_unavailable_reason
from bokehnet.classical.cuda.ray_walk import GROUP_RAYS, make_march
from bokehnet.classical.cuda.renderers import make_on_cuda
from bokehnet.classical.layered.march import resolution_levels
from bokehnet.classical.layered.march.defocus_bins import BINS, TILE, bin_runs
from bokehnet.classical.layered.march.ray_accumulators import GROUPS, PLAIN
from bokehnet.classical.layered.march.ray_marching import SETS
from bokehnet.classical.picture_job import Device
from bokehnet.classical.rays_renderer import render_rays
from bokehnet.classical.torch.device_scatter import cuda_unavailable_reason, scatter_on
from bokehnet.optics.aperture import Aperture, cats_eye_shift

no_cuda = pytest.mark.skipif(
    bool(cuda_unavailable_reason() or cuda_rays_unavailable_reason()), reason="needs a CUDA device"
)


def scene(height: int = 72, width: int = 88) -> tuple[np.ndarray, np.ndarray]:
    """A near disc and a near bar before a slope that leans into the distance."""
    rng = np.random.default_rng(3)
    image = (0.05 + 0.6 * rng.random((height, width, 3))).astype(np.float32)
    y, x = np.mgrid[:height, :width].astype(np.float32)
    defocus = -3 - 0.12 * x
    defocus[np.hypot(x - 30, y - 34) < 14] = 9
    defocus[50:58] = 4.5
    return image, defocus.astype(np.float32)


class CpuMarch:
    """The walk of a device compiled for the CPU, pixel by pixel."""

    def __init__(self) -> None:
        self.march = make_march(numba.njit)
        shift, self.runs = numba.njit(cats_eye_shift), bin_runs
        self.shift = shift

    def __call__(
        self, colors, cells, rays_mask, bins, points, chances, weights, lens, outlines, cats_eye, place,
        seed, above, first, before, counts, sums,
    ):  # fmt: skip
        assert lens is None
        assert outlines is None
        tiles = bins.held, np.float32(bins.low), np.float32(1 / bins.thickness)
        totals, looks = np.empty((GROUPS, PLAIN), np.float32), np.empty((3, GROUP_RAYS), np.float32)
        runs = np.empty((BINS // 2, 2))
        for y, x in np.argwhere(rays_mask[first : first + len(sums)]):
            row, column = (first + y) // TILE, x // TILE
            sent = counts[row - first // TILE, column]
            if sent <= before:
                continue
            count = self.runs(bins.bits[row, column], bins.low, bins.thickness, runs)
            shift = self.shift(cats_eye, x + place[0], first + y + above + place[1], place[2], place[3])
            pattern = (points.shape[1] // SETS, seed, above, cats_eye, *shift)
            self.march(
                x, first + y, colors, cells, tiles, runs, count, bool(bins.smooth[row, column]), points,
                chances, weights, pattern, sums[y, x], totals, looks, before, sent,
            )  # fmt: skip


def decibels(result: np.ndarray, expected: np.ndarray) -> float:
    return float(-10 * np.log10(np.mean((result.astype(float) - expected) ** 2) + 1e-30))


@pytest.fixture(scope="module")
def on_cpu() -> Device:
    return Device(scatter_on("cpu"), CpuMarch())


@pytest.mark.parametrize(
    "aperture",
    [Aperture(), Aperture(blades=6), Aperture(cats_eye=0.8)],
    ids=["disc", "blades", "cat's-eye"],
)
def test_the_walk_of_one_ray_gives_the_picture_of_eight_at_once(on_cpu, aperture):
    image, defocus = scene()
    expected = render_rays(image, defocus, aperture)
    picture = render_rays(image, defocus, aperture, device=on_cpu)
    assert (expected.disocclusion_weight > 0).any()
    assert decibels(picture.bokeh, expected.bokeh) > 60
    assert decibels(picture.disocclusion_weight, expected.disocclusion_weight) > 60


def test_long_rays_that_pass_tiles_in_one_step_give_it_too(on_cpu, monkeypatch):
    """Blur over more than 16 pixels of defocus, and a smooth slope alone, whose surface is looked at.

    Graphics cards march at the full size only.
    """
    monkeypatch.setattr(resolution_levels, "MAX_LEVELS", 0)
    image, defocus = scene()
    slope = np.tile(np.linspace(-6, 6, image.shape[1], dtype=np.float32), (image.shape[0], 1))
    slope[:6] = 30
    for radii in (4 * defocus, slope):
        expected = render_rays(image, radii).bokeh
        assert decibels(render_rays(image, radii, device=on_cpu).bokeh, expected) > 60


SIMULATED = """
import numpy as np
from bokehnet.classical.cuda.march import CudaMarch
from tests.unit.classical.test_cuda_rays import Device, decibels, render_rays, scatter_on, scene
image, defocus = (array[28:52, 16:48].copy() for array in scene())
wanted = render_rays(image, 0.5 * defocus, rays_factor=0.125).bokeh
march = CudaMarch()
device = Device(scatter_on("cpu"), march)
found = render_rays(image, 0.5 * defocus, rays_factor=0.125, device=device).bokeh
print(decibels(found, wanted), len(march._arrays))
"""


@pytest.mark.slow
def test_the_kernel_runs_in_numbas_simulator_of_a_device():
    """It follows the launch: blocks, local arrays, and what goes to the device and back.

    The device keeps no picture once the host has freed it.
    """
    message = os.environ | {"NUMBA_ENABLE_CUDASIM": "1"}
    done = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", SIMULATED],
        env=message,
        capture_output=True,
        text=True,
        timeout=500,
    )
    assert done.returncode == 0, done.stderr[-2000:]
    agreement, kept = done.stdout.split()
    assert float(agreement) > 60
    assert int(kept) == 0


@pytest.mark.gpu
@no_cuda
@pytest.mark.parametrize("aperture", [Aperture(), Aperture(blades=6), Aperture(cats_eye=0.8)])
@pytest.mark.parametrize("name", ["rays", "scatter"])
def test_a_device_gives_the_picture_of_the_cpu(name, aperture):
    from bokehnet.classical.base import make_classical

    image, defocus = scene(300, 400)
    expected = make_classical(name)(image, defocus, aperture).bokeh
    on_card = make_on_cuda(name)
    result = on_card(image, defocus, aperture).bokeh
    assert decibels(result, expected) > 60
    assert (on_card(image, defocus, aperture).bokeh == result).all()


@pytest.mark.gpu
@no_cuda
def test_the_device_frees_the_picture_with_the_host():
    from bokehnet.classical.cuda.march import CudaMarch

    march = CudaMarch()
    render_rays(*scene(), device=Device(scatter_on("cuda"), march))
    assert march._arrays == ()
