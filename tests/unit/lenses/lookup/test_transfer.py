"""The lens ray transfer function against the traced lens that it stands for."""

import dataclasses

import numpy as np
import pytest
import torch
from numpy.testing import assert_allclose

from bokehnet.errors import LensError
from bokehnet.lenses import TransferLens, load_lens
from bokehnet.optics.sampling import disc_from_square, halton

COUNT = 20000
SQUARE = np.stack([halton(COUNT, base) for base in (2, 3, 5, 7)], -1)
UV, DISC = disc_from_square(SQUARE[:, :2]), disc_from_square(SQUARE[:, 2:])


def pair(name, dispersive=False, **settings):
    traced = load_lens(name, **settings)
    fields = {f.name: getattr(traced, f.name) for f in dataclasses.fields(traced)}
    return traced, TransferLens(**fields, dispersive=dispersive)


def errors(traced, table, wavelength=None, offset=None):
    """Error on the sensor, mm, of rays that pass both, and share of rays that pass only one."""
    xy = traced.prescription.image_radius * DISC
    a, b = (lens.sample_rays(xy, UV, wavelength, offset) for lens in (traced, table))
    both = (a.weight > 0) & (b.weight > 0)
    assert both.mean() > 0.8
    assert_allclose(b.weight[both], a.weight[both])
    depth = min(traced.focus_distance, 1e5)
    apart = (a.origin + depth * a.slope - b.origin - depth * b.slope)[both]
    off = np.linalg.norm(apart, axis=-1) * traced.sensor_distance / depth
    return off, ((a.weight > 0) != (b.weight > 0)).mean()


@pytest.mark.parametrize(
    ("name", "largest"),
    [
        ("biconvex", 1e-6),
        ("cooke_triplet", 5e-4),
        ("double_gauss", 3e-3),
        ("petzval", 1e-4),
        ("retrofocus", 1e-2),
        ("telephoto", 1e-3),
    ],
)
def test_rays_are_those_of_the_traced_lens(name, largest):
    """Reference: sequential tracing. Spots of these lenses measure 10 to 150 micrometres."""
    off, differ = errors(*pair(name))
    assert off.max() < largest
    assert differ < 5e-4


def test_double_gauss_is_exact_to_a_micrometre():
    off, _ = errors(*pair("double_gauss"))
    assert np.sqrt((off**2).mean()) < 6e-4


def test_one_table_serves_every_iris_focus_and_sensor_place():
    traced, table = pair("double_gauss", f_number=4.0, focus_distance=900.0)
    off, differ = errors(traced, table, offset=np.linspace(-2, 2, COUNT))
    assert off.max() < 3e-3
    assert differ < 1e-3
    assert table.table is pair("double_gauss")[1].table


def test_a_dispersive_table_holds_every_wavelength():
    traced, table = pair("double_gauss", dispersive=True)
    wavelength = np.linspace(420, 680, COUNT)
    off, _ = errors(traced, table, wavelength)
    assert off.max() < 6e-3
    plain, _ = errors(traced, table, None)
    assert plain.max() < 6e-3


def test_a_table_of_one_wavelength_is_reported():
    with pytest.raises(LensError, match="dispersive=True"):
        pair("biconvex")[1].sample_rays(UV[:4], UV[:4], wavelength=500.0)


def test_torch_gives_the_rays_of_numpy_and_their_gradient():
    _, table = pair("cooke_triplet")
    xy = 15 * DISC[:50]
    array = table.sample_rays(xy, UV[:50])
    tensor = table.sample_rays(torch.from_numpy(xy), torch.from_numpy(UV[:50]))
    assert_allclose(tensor.slope.numpy(), array.slope, rtol=1e-10, atol=1e-13)
    assert_allclose(tensor.weight.numpy(), array.weight, rtol=1e-10)
    inputs = (torch.from_numpy(xy[:2]).requires_grad_(), torch.from_numpy(UV[:2].copy()).requires_grad_())
    assert torch.autograd.gradcheck(lambda *x: table.sample_rays(*x).slope, inputs)


@pytest.mark.parametrize("name", ["biconvex", "double_gauss"])
def test_rays_from_far_outside_the_picture_are_lost_and_finite(name):
    """Also where no rim clips: polynomials must not be trusted beyond the rays that they come from."""
    _, table = pair(name)
    rays = table.sample_rays(np.array([[400.0, 0.0], [0.0, -2000.0]]), np.zeros((2, 2)))
    assert (rays.weight == 0).all()
    assert np.isfinite(rays.slope).all()
