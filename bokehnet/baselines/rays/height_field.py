"""Intersection of rays with height fields whose pixels are squares of one depth: thesis 001, 4.2.

A ray crosses the picture from pixel to pixel. In each pixel it has an entry and an exit depth, and it hits
the first layer between them. Pixel i spans i to i + 1, z grows away from the camera, the layers of a pixel
are sorted by z, and the border values extend outside the picture.

``walk_corners`` tests at each pixel on which side of its corner the ray's end lies, and can step across the
corner; ``walk_edges`` tests which of two edges comes next; ``walk_runs`` crosses all pixels of a row, or of a
column if the ray is steep, in one run without a test. All visit the same pixels, except at corners that a ray
hits. Nearly vertical rays can slip between two squares of a slope, so a ray extends slightly beyond its
pixel in depth.

Source: thesis 001, 4.2.1 and 4.2.2; Amanatides and Woo, "A fast voxel traversal algorithm for ray tracing",
Eurographics 1987; Henning and Stephenson, "Accelerating the ray tracing of height fields", GRAPHITE 2004, for
runs, after thesis 001, 3.2.3. As printed, the first selects the wrong one of two edges, and both a wrong
pixel; see ``docs/method/theses_formulas.md``.
"""

import math

from bokehnet.kernels import njit

__all__ = ["first_between", "walk_corners", "walk_edges", "walk_runs"]

# Distance within which a point is on an edge, and length below which a step is zero, pixels.
_EDGE_TOLERANCE_PX, _MIN_STEP_PX = 1e-9, 1e-9


@njit(cache=True)
def first_between(z, count, row, column, near, far):
    """Return the first layer of a pixel with ``near < z <= far``, or -1.

    Args:
        z: Depths of the layers, (H, W, L).
        count: Number of layers of each pixel, (H, W).
        row: Row of the pixel, clamped to the border.
        column: Column of the pixel, clamped to the border.
        near: Entry depth of the ray.
        far: Exit depth of the ray.
    """
    row = min(max(row, 0), z.shape[0] - 1)
    column = min(max(column, 0), z.shape[1] - 1)
    for layer in range(count[row, column]):
        if z[row, column, layer] > far:
            break
        if z[row, column, layer] > near:
            return layer
    return -1


@njit(cache=True)
def _cell(position, towards):
    """Return the pixel of a position; on an edge the one in the direction ``towards``."""
    low = int(math.floor(position))
    return low - 1 if towards < 0.0 and position - low < _EDGE_TOLERANCE_PX else low


@njit(cache=True)
def _last_cell(position, step, first):
    """Return the last pixel of a path from pixel ``first``; on an edge the one before it."""
    last = _cell(position, -step)
    return last if (last - first) * step >= 0.0 else first


@njit(cache=True)
def walk_edges(z, count, start, end, slack):
    """Trace a ray from edge to edge: 4.2.2.

    Args:
        z: Depths of the layers, (H, W, L).
        count: Number of layers of each pixel, (H, W).
        start: Column, row and depth of the start.
        end: Column, row and depth of the end, farther away.
        slack: Extension of the ray beyond a pixel in depth.

    Returns:
        Row, column and layer of the hit; layer -1 without a hit.
    """
    x0, y0, z0 = start
    dx, dy, dz = end[0] - x0, end[1] - y0, end[2] - z0
    step_x, step_y = 1 if dx >= 0.0 else -1, 1 if dy >= 0.0 else -1
    column, row = _cell(x0, dx), _cell(y0, dy)
    last_column, last_row = _last_cell(end[0], dx, column), _last_cell(end[1], dy, row)
    dx = dx if abs(dx) > _MIN_STEP_PX else step_x * _MIN_STEP_PX
    dy = dy if abs(dy) > _MIN_STEP_PX else step_y * _MIN_STEP_PX
    next_x, next_y = (column + max(step_x, 0) - x0) / dx, (row + max(step_y, 0) - y0) / dy
    entry = z0
    for _ in range(abs(last_column - column) + abs(last_row - row)):
        right = row == last_row or (column != last_column and next_x < next_y)
        leave = z0 + min(next_x if right else next_y, 1.0) * dz
        layer = first_between(z, count, row, column, entry, leave + slack)
        if layer >= 0:
            return row, column, layer
        if right:
            column, next_x = column + step_x, next_x + step_x / dx
        else:
            row, next_y = row + step_y, next_y + step_y / dy
        entry = leave
    return row, column, first_between(z, count, row, column, entry, end[2] + slack)


@njit(cache=True)
def walk_corners(z, count, start, end, slack):
    """Trace a ray by the side of each pixel's nearest corner on which its end lies: 4.2.1.

    Arguments and result are those of :func:`walk_edges`.
    """
    x0, y0, z0 = start
    dx, dy, dz = end[0] - x0, end[1] - y0, end[2] - z0
    sign_x, sign_y = (dx > 0.0) - (dx < 0.0), (dy > 0.0) - (dy < 0.0)
    column, row = _cell(x0, dx), _cell(y0, dy)
    last_column, last_row = _last_cell(end[0], dx, column), _last_cell(end[1], dy, row)
    corner_x, corner_y = column + max(sign_x, 0), row + max(sign_y, 0)
    x, y, entry = x0, y0, z0
    while column != last_column or row != last_row:
        if column == last_column:
            next_x, next_y = 0, sign_y
        elif row == last_row:
            next_x, next_y = sign_x, 0
        else:
            side = (x - corner_x) * (end[1] - corner_y) - (y - corner_y) * (end[0] - corner_x)
            side *= sign_x * sign_y
            next_x, next_y = sign_x * (side >= 0.0), sign_y * (side <= 0.0)
        if next_x != 0 and next_y != 0:
            x, y = float(corner_x), float(corner_y)
        elif next_x != 0:
            y, x = y - dy * (x - corner_x) / dx, float(corner_x)
        else:
            x, y = x - dx * (y - corner_y) / dy, float(corner_y)
        leave = z0 + ((x - x0) * dz / dx if abs(dx) > abs(dy) else (y - y0) * dz / dy)
        layer = first_between(z, count, row, column, entry, leave + slack)
        if layer >= 0:
            return row, column, layer
        column, row, corner_x, corner_y = column + next_x, row + next_y, corner_x + next_x, corner_y + next_y
        entry = leave
    return row, column, first_between(z, count, row, column, entry, end[2] + slack)


@njit(cache=True)
def walk_runs(z, count, start, end, slack):
    """Trace a ray run by run: 3.2.3; within a run only the depth changes, by a constant step.

    Arguments and result are those of :func:`walk_edges`.
    """
    swapped = abs(end[1] - start[1]) > abs(end[0] - start[0])
    major, minor = (1, 0) if swapped else (0, 1)
    p0, q0, z0 = start[major], start[minor], start[2]
    dp, dq, dz = end[major] - p0, end[minor] - q0, end[2] - z0
    step_p, step_q = 1 if dp >= 0.0 else -1, 1 if dq >= 0.0 else -1
    p, q = _cell(p0, dp), _cell(q0, dq)
    last_p, last_q = _last_cell(end[major], dp, p), _last_cell(end[minor], dq, q)
    dp = dp if abs(dp) > _MIN_STEP_PX else step_p * _MIN_STEP_PX
    dq = dq if abs(dq) > _MIN_STEP_PX else step_q * _MIN_STEP_PX
    next_p, gain = (p + max(step_p, 0) - p0) / dp, step_p / dp
    entry = z0
    while True:
        border = (q + max(step_q, 0) - q0) / dq if q != last_q else math.inf
        # All pixels of the run but the last are left across the major edge.
        run = abs(last_p - p)
        if q != last_q:
            run = min(run, max(int(math.ceil((border - next_p) / gain)), 0))
        for _ in range(run):
            leave = z0 + min(next_p, 1.0) * dz
            layer = first_between(z, count, p if swapped else q, q if swapped else p, entry, leave + slack)
            if layer >= 0:
                return (p, q, layer) if swapped else (q, p, layer)
            p, next_p, entry = p + step_p, next_p + gain, leave
        leave = end[2] if q == last_q else z0 + min(border, 1.0) * dz
        layer = first_between(z, count, p if swapped else q, q if swapped else p, entry, leave + slack)
        if layer >= 0 or q == last_q:
            return (p, q, layer) if swapped else (q, p, layer)
        q, entry = q + step_q, leave
