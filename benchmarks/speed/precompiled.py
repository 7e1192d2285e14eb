"""Precompiled kernels against kernels that numba compiles for this processor.

Run ``python -m benchmarks.speed.precompiled [--rounds N]``. Both render the demo scene alternately with the
same settings in one process. The table shows CPU seconds (medians), the median ratio of N pairs, and the
difference of the pictures in dB.
"""

import argparse
import contextlib
import statistics
import time
from typing import Any

import numpy as np

from bokehnet.precompiled.kernel import record_calls
from bokehnet.render.renderer import BokehRenderer
from bokehnet.tools.demo import demo_scene, demo_settings

_LOOKS: dict[str, dict[str, Any]] = {
    "scatter": {"engine": {"name": "scatter"}},
    "rays": {},
    "six blades, scatter": {"engine": {"name": "scatter"}, "aperture": {"blades": 6}},
    "colour fringes, rays": {"color": {"axial": 0.4}},
    "lens double_gauss, rays": {"lens": {"name": "double_gauss"}},
}


def main() -> None:
    """Run the benchmark and print its table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=9, help="number of timed pairs; default 9")
    rounds = parser.parse_args().rounds
    renderer, scene = BokehRenderer(), demo_scene()
    print("| what | numba, CPU s | precompiled, CPU s | precompiled / numba | difference, dB |")
    print("|---|---|---|---|---|")
    for name, look in _LOOKS.items():
        settings = demo_settings("middle").updated(look)
        seconds: dict[bool, list[float]] = {True: [], False: []}
        pictures = {}
        for pair_index in range(rounds + 1):
            for by_numba in (pair_index % 2 == 0, pair_index % 2 == 1):
                start = time.process_time()
                with record_calls() if by_numba else contextlib.nullcontext():
                    pictures[by_numba] = renderer.render(scene, settings).bokeh
                if pair_index > 0:  # the first pair compiles or loads the kernels
                    seconds[by_numba].append(time.process_time() - start)
        ratio = statistics.median(
            result / reference for result, reference in zip(seconds[False], seconds[True], strict=True)
        )
        error = float(np.sqrt(np.mean((pictures[True] - pictures[False]) ** 2, dtype=np.float64)))
        difference = "equal" if error == 0 else f"{-20 * np.log10(error / pictures[True].max()):.0f}"
        medians = [statistics.median(seconds[by_numba]) for by_numba in (True, False)]
        print(f"| {name} | {medians[0]:.3f} | {medians[1]:.3f} | {ratio:.3f} | {difference} |", flush=True)


if __name__ == "__main__":
    main()
