"""Transfer curves, against the standards that define them."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from bokehnet.io.color.color_space import COLOR_SPACES, SRGB, cicp_space, convert
from bokehnet.io.color.transfer import HLG, PQ, Curve, power


def test_pq_decodes_to_luminance():
    """ITU-R BT.2408-7, table 1: 58 % is 203 cd/m^2; BT.2100-2, table 4: 100 % is 10 000 cd/m^2."""
    light = PQ.decode(np.array([0.0, 0.5806, 1.0]))
    assert_allclose(light, [0, 1, 10000 / 203], rtol=2e-3, atol=1e-9)


def test_hlg_decodes_to_scene_light():
    """ITU-R BT.2100-2, table 5: 0.5 is a twelfth of the peak; BT.2408-7: 75 % is reference white."""
    light = HLG.decode(np.array([0.0, 0.5, 0.75, 1.0]))
    assert light[2] == 1
    assert_allclose(light[[0, 1]] / light[3], [0, 1 / 12], atol=1e-6)
    assert_allclose(light[3], 1 / 0.26496, rtol=1e-4)


@pytest.mark.parametrize(
    "curve", [PQ, HLG, power(2.2), Curve("table", (0.0, 0.0, 0.2, 1.0)), COLOR_SPACES["rec2020"].curves[0]]
)
def test_encoding_undoes_decoding(curve):
    stored = np.linspace(0.34, 1, 500)
    assert_allclose(curve.encode(curve.decode(stored)), stored, atol=1e-6)


def test_ends_of_a_table_with_equal_light_are_black_and_white():
    curve = Curve("table", (0.0, 0.0, 0.2, 1.0, 1.0))
    assert_allclose(curve.encode(np.array([0.0, 1.0])), [0, 1])


def test_rec2020_is_the_inverse_of_its_camera_curve():
    """ITU-R BT.2020-2, table 4, with the constants for 12 bits."""
    light = np.linspace(0, 1, 200)
    stored = np.where(light < 0.0181, 4.5 * light, 1.0993 * light**0.45 - 0.0993)
    assert_allclose(COLOR_SPACES["rec2020"].curves[0].decode(stored), light, atol=2e-4)


def test_rec2020_reaches_rec709_by_the_matrix_of_its_report():
    """ITU-R BT.2087-0, 2015, the inverse of its M2."""
    wide = COLOR_SPACES["rec2020"]
    result = convert(np.eye(3, dtype=np.float32)[None], SRGB, wide)[0].T
    matrix = [[0.6274, 0.3293, 0.0433], [0.0691, 0.9195, 0.0114], [0.0164, 0.0880, 0.8956]]
    assert_allclose(result, matrix, atol=2e-4)


def test_code_points_of_srgb_are_srgb():
    assert cicp_space(1, 13) is SRGB
    assert cicp_space(7, 13) is None
    assert cicp_space(12, 13).shares_primaries(COLOR_SPACES["display-p3"])
