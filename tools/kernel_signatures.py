"""Rewrite the list of precompiled kernels: ``python -m tools.kernel_signatures``.

The command runs the command lines of the golden set (:mod:`benchmarks.golden`) and the demo, and records the
argument types of all kernel calls. It is needed to precompile a new kernel or a new argument type; until then
numba compiles at the first call.
"""

import os
import tempfile
from pathlib import Path

from tools.kernel_library import SIGNATURES, short_name

_HEAD = "# Kernels that are compiled ahead, and types of their arguments; python -m tools.kernel_signatures\n"


def main() -> None:
    """Run all commands and write the recorded signatures."""
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

    start_folder = Path.cwd()
    inputs = folder / "inputs"
    inputs.mkdir()
    golden.make_inputs(inputs)
    for name, words in golden.RENDERS.items():
        if "--jobs" not in words:  # calls in other processes are not recorded
            golden.in_folder(folder / name, inputs, lambda words=words: run(["render", *words]))
    golden.in_folder(folder / "demo", inputs, lambda: run(["demo", "-o", "out.png"]))
    os.chdir(start_folder)


if __name__ == "__main__":
    main()
