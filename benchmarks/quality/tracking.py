"""Error of tracked points on synthetic shots: ``python -m benchmarks.quality.tracking``.

A textured disc moves along a known path before a moving ground, 50 frames of 480x270; a point beside its
middle is tracked (:mod:`bokehnet.sequence.tracking`). Prints, for each path and noise of the encoded light,
the largest distance from the true position in pixels and the frame of a loss. With OpenCV installed, also
with its dense inverse search in place of the package's flow.

Source: Kroeger et al., "Fast optical flow using dense inverse search", ECCV 2016, for OpenCV's flow.
"""

import importlib
from collections.abc import Callable
from types import ModuleType

import numpy as np
import numpy.typing as npt
from scipy.ndimage import gaussian_filter, map_coordinates

from bokehnet.sequence import tracking
from bokehnet.sequence.optical_flow import optical_flow

Array = npt.NDArray[np.float32]
Path = Callable[[int], tuple[float, float, float]]

_HEIGHT, _WIDTH, _FRAMES, _RADIUS = 270, 480, 50, 45
_OFFSET = (10, -6)  # of the tracked point from the middle of the disc

# Middle of the disc and its magnification by frame.
_PATHS: dict[str, Path] = {
    "slow": lambda t: (100 + 2.1 * t, 120 + 0.7 * t, 1 + 0.004 * t),
    "fast": lambda t: (60 + 6.3 * t, 140 + 60 * np.sin(t / 9), 1),
    "zoom": lambda t: (240 + 15 * np.sin(t / 5), 135, 1 + 0.012 * t),
    "hand": lambda t: (200 + 20 * np.sin(t / 4) + 1.5 * t, 130 + 12 * np.cos(t / 2.7), 1),
}


def texture(seed: int) -> npt.NDArray[np.float64]:
    """Return grain of three sizes, (600, 600), about 0.5."""
    noise = np.random.default_rng(seed).standard_normal
    grain = sum(gaussian_filter(noise((600, 600)), size) * size for size in (1.2, 3, 8))
    return np.asarray(0.5 + 0.15 * (grain - np.mean(grain)) / np.std(grain))


def frame(t: int, path: Path, noise: float, textures: tuple[Array, Array]) -> Array:
    """Return the encoded light of a frame, (H, W, 3)."""
    ground, disc = textures
    x0, y0, scale = path(t)
    y, x = np.mgrid[:_HEIGHT, :_WIDTH].astype(float)
    u, v = (x - x0) / scale, (y - y0) / scale
    behind = map_coordinates(ground, [(y + 30 + 0.3 * t) % 590, (x + 10 + 1.2 * t) % 590], order=1)
    front = map_coordinates(disc, [v + 300, u + 300], order=1, mode="nearest")
    picture = np.where(u * u + v * v < _RADIUS**2, front, behind)
    picture = picture + noise * np.random.default_rng(t).standard_normal(picture.shape)
    return np.repeat(np.clip(picture, 0, 1)[..., None], 3, 2).astype(np.float32)


def dense_inverse_search(cv2: ModuleType) -> Callable[[Array, Array], Array]:
    """Return OpenCV's flow with its medium preset, as :func:`optical_flow`."""
    search = cv2.DISOpticalFlow_create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM)

    def flow(first: Array, second: Array) -> Array:
        grey = [np.rint(255 * picture.mean(2)).astype(np.uint8) for picture in (first, second)]
        return np.asarray(search.calc(*grey, None), np.float32)

    return flow


def main() -> None:
    """Print a row for each path, noise and flow."""
    flows = {"own": optical_flow}
    try:
        flows["OpenCV DIS"] = dense_inverse_search(importlib.import_module("cv2"))
    except ImportError:
        print("OpenCV is not installed: own flow only")
    textures = texture(1), texture(2)
    for name, path in _PATHS.items():
        for noise in (0.0, 0.02):
            frames = [(t, frame(t, path, noise, textures)) for t in range(_FRAMES)]
            for label, flow in flows.items():
                tracking.optical_flow = flow
                true = [(x + _OFFSET[0] * s, y + _OFFSET[1] * s) for x, y, s in map(path, range(_FRAMES))]
                points = list(tracking.track_point(frames, *true[0]))
                kept = [point for point in points if not point.is_lost]
                error = max(np.hypot(p.x - true[p.number][0], p.y - true[p.number][1]) for p in kept)
                lost = f"lost in frame {len(kept)}" if len(kept) < _FRAMES else "kept"
                print(f"{name:5} noise {noise:.2f} {label:10} {error:5.2f} px, {lost}", flush=True)
    tracking.optical_flow = optical_flow


if __name__ == "__main__":
    main()
