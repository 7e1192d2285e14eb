"""Rewrite the list of kernels that are compiled ahead: ``python -m tools.kernel_signatures``.

It runs the command lines of the golden set (:mod:`benchmarks.golden`) and the demo, and notes for which types
of arguments they call which kernels. Needed when a new kernel or a new type of argument shall be compiled
ahead; until then numba compiles it at its first call.
"""

import os
import tempfile
from pathlib import Path

from tools.kernel_library import SIGNATURES, short_name

_HEAD = "# Kernels that are compiled ahead, and types of their arguments; python -m tools.kernel_signatures\n"


def main() -> None:
    """Run everything, and write down what was called."""
    from bokehnet.precompiled.kernel import KERNELS, record_calls

    with tempfile.TemporaryDirectory() as folder, record_calls():
        _run_everything(Path(folder))
    lines = sorted(
        f"{short_name(kernel.name)} {description}\n"
        for kernel in KERNELS.values()
        for description in kernel.called
    )
    SIGNATURES.write_text(_HEAD + "".join(lines), "utf-8")
    print(f"{len(lines)} signatures in {SIGNATURES.name}")


def _run_everything(folder: Path) -> None:
    from benchmarks import golden
    from bokehnet.cli.app import run

    here = Path.cwd()
    inputs = folder / "inputs"
    inputs.mkdir()
    golden.make_inputs(inputs)
    for name, words in golden.RENDERS.items():
        if "--jobs" not in words:  # other programs' calls are not seen here
            golden.in_folder(folder / name, inputs, lambda words=words: run(["render", *words]))
    golden.in_folder(folder / "demo", inputs, lambda: run(["demo", "-o", "out.png"]))
    os.chdir(here)


if __name__ == "__main__":
    main()
