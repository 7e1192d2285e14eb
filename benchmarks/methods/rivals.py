"""Rivals of the classical renderers: the usual implementation of the scatter, and GEGL's lens blur.

Both accept ``(image, defocus)`` like the package's scatter and blur by the same radii.
"""

import ctypes
import ctypes.util
import math
import os
from collections.abc import Callable

import numpy as np
from numba import get_num_threads, njit, prange

__all__ = ["double_loop", "open_lens_blur"]

# Radius of a disc inside its own pixel; smaller discs give the same picture.
SMALLEST_RADIUS = 0.5


@njit(cache=True)
def _area_left_of(x, radius):  # type: ignore[no-untyped-def]
    """Return the area between the x axis and the semicircle of ``radius`` around 0, from 0 to ``x``."""
    t = min(max(x / radius, -1.0), 1.0)
    return 0.5 * radius * radius * (t * math.sqrt(1.0 - t * t) + math.asin(t))


@njit(cache=True)
def _area_in_quadrant(left, right, bottom, top, radius):  # type: ignore[no-untyped-def]
    """Return the area of the disc inside a rectangle in the first quadrant, by one integral along x."""
    if left * left + bottom * bottom >= radius * radius:
        return 0.0
    full = math.sqrt(max(radius * radius - top * top, 0.0))  # up to here the circle passes above
    end = min(right, math.sqrt(max(radius * radius - bottom * bottom, 0.0)))
    start = min(max(left, full), end)
    curved = _area_left_of(end, radius) - _area_left_of(start, radius) - bottom * (end - start)
    return (start - left) * (top - bottom) + curved


@njit(cache=True)
def disc_coverage(u, v, radius):  # type: ignore[no-untyped-def]
    """Return the exact coverage of the pixel at offset (u, v) by the disc of ``radius`` around 0."""
    u, v = abs(u), abs(v)
    nearest = max(u - 0.5, 0.0) ** 2 + max(v - 0.5, 0.0) ** 2
    if nearest >= radius * radius:
        return 0.0
    if (u + 0.5) ** 2 + (v + 0.5) ** 2 <= radius * radius:
        return 1.0
    # A pixel on an axis is two or four times its part in the first quadrant.
    left, bottom = max(u - 0.5, 0.0), max(v - 0.5, 0.0)
    copies = (2.0 if u == 0 else 1.0) * (2.0 if v == 0 else 1.0)
    return copies * _area_in_quadrant(left, u + 0.5, bottom, v + 0.5, radius)


@njit(parallel=True, cache=True)
def _add_discs(image, defocus, sums):  # type: ignore[no-untyped-def]
    """Add the discs of all pixels, each thread its own rows to its own picture (H, W, 4)."""
    height, width, _ = image.shape
    threads = sums.shape[0]
    for thread in prange(threads):
        for y in range(thread, height, threads):
            for x in range(width):
                radius = max(abs(float(defocus[y, x])), SMALLEST_RADIUS)
                reach = int(math.floor(radius + 0.5))
                scale = 1.0 / (math.pi * radius * radius)
                for v in range(max(0, y - reach), min(height, y + reach + 1)):
                    for u in range(max(0, x - reach), min(width, x + reach + 1)):
                        weight = np.float32(scale * disc_coverage(u - x, v - y, radius))
                        sums[thread, v, u, 0] += weight * image[y, x, 0]
                        sums[thread, v, u, 1] += weight * image[y, x, 1]
                        sums[thread, v, u, 2] += weight * image[y, x, 2]
                        sums[thread, v, u, 3] += weight


def double_loop(image: np.ndarray, defocus: np.ndarray) -> np.ndarray:
    """Return the normalised scatter, implemented literally: every pixel adds its colour to its disc.

    The weights are exact: the area of the disc on each pixel, divided by the area of the disc. Uses all numba
        threads.

    Args:
        image: Scene-linear, (H, W, 3) float32.
        defocus: Blur radius in pixels, (H, W); its sign is ignored.
    """
    sums = np.zeros((get_num_threads(), *defocus.shape, 4), np.float32)
    _add_discs(image, defocus, sums)
    total = sums.sum(axis=0)
    return total[..., :3] / total[..., 3:]


class _Rectangle(ctypes.Structure):
    """Layout of GeglRectangle."""

    _fields_ = [(name, ctypes.c_int) for name in ("x", "y", "width", "height")]


def open_lens_blur(threads: int) -> Callable[[np.ndarray, np.ndarray], Callable[[], np.ndarray]] | None:
    """Return GEGL's ``gegl:lens-blur`` (Ell, 2017) by its C library, or ``None`` if it is not installed.

    The operation spreads row ends over whole pixels, like ours: its radius r covers the pixels with centres
        within r + 1/2, so our radius minus 1/2 gives a disc of equal area.

    Args:
        threads: Number of threads of GEGL, for the rest of this process.

    Returns:
        A function that passes a picture and its defocus to GEGL and returns the function to time, which blurs
        without files and pixel conversions.
    """
    libraries = ctypes.util.find_library("gegl-0.4"), ctypes.util.find_library("babl-0.1")
    if None in libraries:
        return None
    os.environ["GEGL_THREADS"] = str(threads)
    gegl, babl = (ctypes.CDLL(name) for name in libraries)
    pointer = ctypes.c_void_p
    for function in (gegl.gegl_buffer_new, gegl.gegl_node_new, gegl.gegl_node_new_child, babl.babl_format):
        function.restype = pointer
    gegl.gegl_init(None, None)

    def prepare(image: np.ndarray, defocus: np.ndarray) -> Callable[[], np.ndarray]:
        height, width = defocus.shape
        area = ctypes.byref(_Rectangle(0, 0, width, height))
        graph = pointer(gegl.gegl_node_new())

        def source(pixels: np.ndarray, kind: bytes) -> ctypes.c_void_p:
            form = pointer(babl.babl_format(kind))
            buffer = pointer(gegl.gegl_buffer_new(area, form))
            gegl.gegl_buffer_set(buffer, area, 0, form, pixels.ctypes.data_as(pointer), 0)
            return node(b"gegl:buffer-source", b"buffer", buffer)

        def node(name: bytes, *properties: object) -> ctypes.c_void_p:
            return pointer(gegl.gegl_node_new_child(graph, b"operation", name, *properties, None))

        radius = np.maximum(np.abs(defocus) - SMALLEST_RADIUS, 0).astype(np.float32)
        largest = float(radius.max())
        rgba = np.concatenate([image, np.ones_like(image[..., :1])], axis=-1)
        size = ctypes.c_double(largest)
        blur = node(b"gegl:lens-blur", b"radius", size, b"linear-mask", ctypes.c_int(1))
        picture, mask = source(rgba, b"RGBA float"), source(radius / np.float32(largest), b"Y float")
        gegl.gegl_node_connect_to(picture, b"output", blur, b"input")
        gegl.gegl_node_connect_to(mask, b"output", blur, b"aux")
        result = np.zeros((height, width, 4), np.float32)

        def run() -> np.ndarray:
            target = result.ctypes.data_as(pointer)
            form = pointer(babl.babl_format(b"RGBA float"))
            gegl.gegl_node_blit(blur, ctypes.c_double(1.0), area, form, target, 0, 0)
            return result[..., :3]

        return run

    return prepare
