"""Compiled lookup of baked colours at ray hits."""

import numpy as np

from bokehnet.kernels import njit

__all__ = ["mean_colours"]


@njit(cache=True)
def _mirrored(position: float, size: int) -> tuple[int, int, float]:
    """Return two neighbouring texels and the second's weight at ``position``, in picture sides, mirrored."""
    position = position - 2.0 * np.floor(0.5 * position)
    position = min(position, 2.0 - position) * size - 0.5
    low = int(np.floor(position))
    weight = position - low
    return max(low, 0), min(low + 1, size - 1), weight


@njit(cache=True, fastmath={"contract", "reassoc", "nsz"})
def mean_colours(
    triangle: np.ndarray,
    first: np.ndarray,
    second: np.ndarray,
    slope: np.ndarray,
    weight: np.ndarray,
    corners: tuple[np.ndarray, np.ndarray, np.ndarray],
    surfaces: tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray],
    sky: np.ndarray,
    sky_half: np.ndarray,
) -> np.ndarray:
    """Return the mean colours (P, 3) over the rays of each pixel.

    Args:
        triangle: Index of the triangle that each ray hits, (P, S) int32; -1 is the sky.
        first: Barycentric weight of the triangle's second corner, (P, S).
        second: Barycentric weight of its third corner, (P, S).
        slope: Slopes of the rays, (P, S, 2).
        weight: Weights of the rays, (P, S).
        corners: "uv", "grid" and "mesh" of ``Soup``.
        surfaces: Packed textures and their table, packed irradiance and its table, and the texture of each
            mesh.
        sky: Radiance of the sky, (h, w, 3).
        sky_half: Half width and half height of the sky, slopes.
    """
    uv, grid, mesh = corners
    albedo, albedo_table, light, light_table, texture = surfaces
    pixels, samples = triangle.shape
    result = np.empty((pixels, 3), np.float32)
    for p in range(pixels):
        red, green, blue, total = 0.0, 0.0, 0.0, 0.0
        for s in range(samples):
            w = weight[p, s]
            if w <= 0.0:
                continue
            total += w
            t = triangle[p, s]
            if t < 0:
                i0, i1, fi = _mirrored(0.5 * (slope[p, s, 1] / sky_half[1] + 1.0), sky.shape[0])
                j0, j1, fj = _mirrored(0.5 * (slope[p, s, 0] / sky_half[0] + 1.0), sky.shape[1])
                a, b = w * (1.0 - fi) * (1.0 - fj), w * (1.0 - fi) * fj
                c, d = w * fi * (1.0 - fj), w * fi * fj
                red += a * sky[i0, j0, 0] + b * sky[i0, j1, 0] + c * sky[i1, j0, 0] + d * sky[i1, j1, 0]
                green += a * sky[i0, j0, 1] + b * sky[i0, j1, 1] + c * sky[i1, j0, 1] + d * sky[i1, j1, 1]
                blue += a * sky[i0, j0, 2] + b * sky[i0, j1, 2] + c * sky[i1, j0, 2] + d * sky[i1, j1, 2]
                continue
            v, u = first[p, s], second[p, s]
            r = 1.0 - v - u
            body = mesh[t]
            start, rows, columns = albedo_table[texture[body]]
            y = r * uv[t, 0, 0] + v * uv[t, 1, 0] + u * uv[t, 2, 0]
            x = r * uv[t, 0, 1] + v * uv[t, 1, 1] + u * uv[t, 2, 1]
            i0, i1, fi = _mirrored(y, rows)
            j0, j1, fj = _mirrored(x, columns)
            n0, n1 = start + i0 * columns, start + i1 * columns
            a, b = (1.0 - fi) * (1.0 - fj), (1.0 - fi) * fj
            c, d = fi * (1.0 - fj), fi * fj
            start, rows, columns = light_table[body]
            y = (r * grid[t, 0, 0] + v * grid[t, 1, 0] + u * grid[t, 2, 0]) * (rows - 1)
            x = (r * grid[t, 0, 1] + v * grid[t, 1, 1] + u * grid[t, 2, 1]) * (columns - 1)
            k0, l0 = min(max(int(y), 0), rows - 2), min(max(int(x), 0), columns - 2)
            fk, fl = y - k0, x - l0
            m0 = start + k0 * columns + l0
            m1 = m0 + columns
            e, f = w * (1.0 - fk) * (1.0 - fl), w * (1.0 - fk) * fl
            g, h = w * fk * (1.0 - fl), w * fk * fl
            red += (
                a * albedo[n0 + j0, 0]
                + b * albedo[n0 + j1, 0]
                + c * albedo[n1 + j0, 0]
                + d * albedo[n1 + j1, 0]
            ) * (e * light[m0, 0] + f * light[m0 + 1, 0] + g * light[m1, 0] + h * light[m1 + 1, 0])
            green += (
                a * albedo[n0 + j0, 1]
                + b * albedo[n0 + j1, 1]
                + c * albedo[n1 + j0, 1]
                + d * albedo[n1 + j1, 1]
            ) * (e * light[m0, 1] + f * light[m0 + 1, 1] + g * light[m1, 1] + h * light[m1 + 1, 1])
            blue += (
                a * albedo[n0 + j0, 2]
                + b * albedo[n0 + j1, 2]
                + c * albedo[n1 + j0, 2]
                + d * albedo[n1 + j1, 2]
            ) * (e * light[m0, 2] + f * light[m0 + 1, 2] + g * light[m1, 2] + h * light[m1 + 1, 2])
        scale = 1.0 / total if total > 0.0 else 0.0
        result[p, 0], result[p, 1], result[p, 2] = scale * red, scale * green, scale * blue
    return result
