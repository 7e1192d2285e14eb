"""Positions of the rays of one light behind an aberrated lens, as polynomials over the pupil.

The aberration map gives the origin of the rays of each pixel. A light needs the inverse: the pixel p with
``p = q + d A(a, h(p)) + E(a, h(p))``. Field positions change slowly over a disc, so a fixed-point iteration
solves the equation. The solution is a smooth function of a; the polynomial through Chebyshev nodes
interpolates it.

Source: Trefethen, "Approximation theory and approximation practice", SIAM 2013, for Chebyshev nodes.
"""

import math
from typing import NamedTuple

import numpy as np

from bokehnet.arrays.viewport import Frame
from bokehnet.kernels import njit
from bokehnet.optics.aberrations.aberration_map import TERMS
from bokehnet.optics.aberrations.lens_response import LensResponse

__all__ = ["NODES", "RayPolynomials", "polynomials", "solve_nodes"]

# Nodes along each side of the pupil's square.
NODES = 10

# Maximum number of iterations, and the change in pixels at which they end.
_MAX_ITERATIONS, _TOLERANCE_PX = 6, 1e-3

# Field positions along each side of the square [-_EDGE, _EDGE]^2 of the maps of chromatic aberration.
_FIELDS, _EDGE = 65, 1.25

_EXPONENTS = np.array(TERMS)


class RayPolynomials(NamedTuple):
    """Lens response for one picture, in the form that kernels read.

    Attributes:
        coefficients: Coefficients of f and g of the transverse aberration in pixels and of the pupil
            aberration, (wavelengths, 4, 20).
        tilt: Tilt of the aberration map, and its axes of the aperture, (4, 2).
        chromatic_aberration: Axial and lateral strength of each wavelength, pixels, (wavelengths, 2).
        maps: Factors of these over the field, (fields, fields, 2); or (1, 1, 2) without chromatic aberration.
        frame: Column, row and scale of a :class:`Frame`, (3,).
        nodes: Chebyshev nodes, (NODES,).
        inverse: Matrix from values at the nodes to coefficients of powers, (NODES, NODES).
    """

    coefficients: np.ndarray
    tilt: np.ndarray
    chromatic_aberration: np.ndarray
    maps: np.ndarray
    frame: np.ndarray
    nodes: np.ndarray
    inverse: np.ndarray

    @classmethod
    def of(cls, lens_response: LensResponse, wavelengths: np.ndarray, frame: Frame) -> "RayPolynomials":
        """Prepare a lens response for wavelengths in nm."""
        aberration_map = lens_response.aberration_map
        transverse_aberration, pupil_aberration = aberration_map.at(wavelengths)
        half_diagonal = 1 / frame.scale
        nodes = np.cos((2 * np.arange(NODES) + 1) * (math.pi / (2 * NODES)))
        chromatic_aberration, maps = np.zeros((len(wavelengths), 2)), np.zeros((1, 1, 2))
        if lens_response.chromatic_aberration is not None:
            axis = np.linspace(-_EDGE, _EDGE, _FIELDS)
            field = np.stack(np.meshgrid(axis, axis), -1)
            chromatic_aberration = half_diagonal * np.asarray(
                lens_response.chromatic_aberration.strengths(wavelengths), float
            )
            maps = np.ascontiguousarray(lens_response.chromatic_aberration.maps(field), float)
        return cls(
            coefficients=np.concatenate([half_diagonal * transverse_aberration, pupil_aberration], axis=1),
            tilt=np.array((aberration_map.tilt, *aberration_map.aperture_axes), float),
            chromatic_aberration=chromatic_aberration,
            maps=maps,
            frame=np.array(frame, float),
            nodes=nodes,
            inverse=np.linalg.inv(np.vander(nodes, increasing=True)),
        )


@njit(cache=True)
def _field(paths, x, y):
    """Return the field position of a pixel; beyond the corners it stays, smoothly, below 1.25."""
    h_x, h_y = (x - paths.frame[0]) * paths.frame[2], (y - paths.frame[1]) * paths.frame[2]
    distance = math.hypot(h_x, h_y)
    if distance > 1.0:
        scale = (1.0 + 0.25 * math.tanh(4.0 * (distance - 1.0))) / distance
        h_x, h_y = h_x * scale, h_y * scale
    return h_x, h_y


@njit(cache=True)
def _map_at(maps, index, h_x, h_y):
    """Return one of the maps of chromatic aberration at a field position."""
    last = maps.shape[0] - 1
    column = min(max((h_x / _EDGE + 1.0) * 0.5 * last, 0.0), last - 1e-9)
    row = min(max((h_y / _EDGE + 1.0) * 0.5 * last, 0.0), last - 1e-9)
    j, i = int(column), int(row)
    x, y = column - j, row - i
    upper = maps[i, j, index] * (1.0 - x) + maps[i, j + 1, index] * x
    lower = maps[i + 1, j, index] * (1.0 - x) + maps[i + 1, j + 1, index] * x
    return upper * (1.0 - y) + lower * y


@njit(cache=True)
def _send(paths, k, u, v, h_x, h_y, powers):
    """Return transverse aberration E in pixels and coordinates A of one ray of the k-th wavelength."""
    for n in range(4):
        powers[0, n] = 1.0 if n == 0 else powers[0, n - 1] * (u * u + v * v)
        powers[1, n] = 1.0 if n == 0 else powers[1, n - 1] * (u * h_x + v * h_y)
        powers[2, n] = 1.0 if n == 0 else powers[2, n - 1] * (h_x * h_x + h_y * h_y)
    f = g = f_bend = g_bend = 0.0
    for n in range(_EXPONENTS.shape[0]):
        value = powers[0, _EXPONENTS[n, 0]] * powers[1, _EXPONENTS[n, 1]] * powers[2, _EXPONENTS[n, 2]]
        f += value * paths.coefficients[k, 0, n]
        g += value * paths.coefficients[k, 1, n]
        f_bend += value * paths.coefficients[k, 2, n]
        g_bend += value * paths.coefficients[k, 3, n]
    if paths.maps.shape[0] > 1:
        f += paths.chromatic_aberration[k, 0] * _map_at(paths.maps, 0, h_x, h_y)
        g += paths.chromatic_aberration[k, 1] * _map_at(paths.maps, 1, h_x, h_y)
    divisor = 1.0 + paths.tilt[0, 0] * u + paths.tilt[0, 1] * v
    a_x, a_y = u + u * f_bend + h_x * g_bend, v + v * f_bend + h_y * g_bend
    along = paths.tilt[3, 0] * a_x + paths.tilt[3, 1] * a_y
    return (
        u * f + h_x * g,
        v * f + h_y * g,
        (paths.tilt[1, 0] * a_x + paths.tilt[1, 1] * a_y - along * h_x) / divisor,
        (paths.tilt[2, 0] * a_x + paths.tilt[2, 1] * a_y - along * h_y) / divisor,
    )


@njit(cache=True)
def solve_nodes(paths, k, light_x, light_y, depth, nodes):
    """Write the positions of rays through the nodes of the pupil.

    Args:
        paths: Lens response.
        k: Index of the wavelength.
        light_x: Column of the light.
        light_y: Row of the light.
        depth: Defocus of the light, pixels.
        nodes: Output, (4, NODES, NODES) with rows along v: offset from the light, right and down, and
            transverse aberration, right and down, all in pixels.
    """
    powers = np.empty((3, 4))
    for row in range(NODES):
        for column in range(NODES):
            u, v = paths.nodes[column], paths.nodes[row]
            x, y, e_x, e_y = depth * u, depth * v, 0.0, 0.0
            for _ in range(_MAX_ITERATIONS):
                h_x, h_y = _field(paths, light_x + x, light_y + y)
                e_x, e_y, a_x, a_y = _send(paths, k, u, v, h_x, h_y, powers)
                previous_x, previous_y = x, y
                x, y = depth * a_x + e_x, depth * a_y + e_y
                if abs(x - previous_x) + abs(y - previous_y) < _TOLERANCE_PX:
                    break
            nodes[0, row, column], nodes[1, row, column] = x, y
            nodes[2, row, column], nodes[3, row, column] = e_x, e_y


@njit(cache=True)
def polynomials(paths, nodes, terms):
    """Write the polynomials through the nodes by powers of v and u, (4, NODES, NODES)."""
    for index in range(4):
        for row in range(NODES):
            for power in range(NODES):
                value = 0.0
                for column in range(NODES):
                    value += paths.inverse[power, column] * nodes[index, row, column]
                terms[index, row, power] = value
        for power in range(NODES):
            line = terms[index, :, power].copy()
            for order in range(NODES):
                value = 0.0
                for row in range(NODES):
                    value += paths.inverse[order, row] * line[row]
                terms[index, order, power] = value
