"""Running a few nodes in ONNX Runtime."""

import numpy as np
import onnxruntime

from bokehnet.onnx_file.builder import Graph


def start(model, threads=1):
    """A session on the CPU."""
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = threads
    options.log_severity_level = 3
    return onnxruntime.InferenceSession(
        model.SerializeToString(), options, providers=["CPUExecutionProvider"]
    )


def compiled(build, *ranks, threads=1):
    """Return ``build(graph, *values)`` for float32 arrays of these ranks, as a function on arrays."""
    g = Graph()
    inputs = [
        g.input(f"in{i}", np.float32, [f"side{i}_{axis}" for axis in range(rank)])
        for i, rank in enumerate(ranks)
    ]
    results = build(g, *inputs)
    results = results if isinstance(results, (list, tuple)) else [results]
    session = start(g.model({f"out{i}": (value, None) for i, value in enumerate(results)}), threads)

    def call(*arrays):
        fed = {f"in{i}": np.ascontiguousarray(x, np.float32) for i, x in enumerate(arrays)}
        result = session.run(None, fed)
        return result if len(result) > 1 else result[0]

    return call


def picture(height, width, seed=0):
    """Noise (H, W, 3)."""
    return np.random.default_rng(seed).random((height, width, 3), dtype=np.float32)


def steps(height, width, radius, seed=1):
    """A defocus map of slopes and steps, its largest magnitude ``radius``."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[:height, :width]
    defocus = 0.4 * y / height - 0.3
    for _ in range(5):
        inside = np.hypot(y - rng.uniform(0, height), x - rng.uniform(0, width)) < rng.uniform(
            2, 2 + width / 4
        )
        defocus = np.where(inside, rng.uniform(-1, 1), defocus)
    return (radius * defocus / max(np.abs(defocus).max(), 1e-9)).astype(np.float32)


def decibels(one, other):
    """PSNR with a peak of 1."""
    return -10 * np.log10(np.square(one.astype(float) - other).mean() + 1e-30)
