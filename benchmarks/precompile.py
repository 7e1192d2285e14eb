"""Compile the kernels that the package ships as machine code: ``python -m benchmarks.precompile``.

Whoever has changed a kernel runs this once, before the change is handed on; it takes four minutes on a core,
and needs gcc on Linux on x86-64. Kernels are compiled for the types that the golden set
(:mod:`benchmarks.golden`) calls them with; for others numba compiles them at their first call.
"""

import os
import subprocess
import sys
import tempfile
from pathlib import Path

import bokehnet

_FOLDER = Path(bokehnet.__file__).parent / "precompiled"

# What numba compiles for: its loops are those that all classes get.
_NUMBA = {"NUMBA_CPU_NAME": "x86-64-v3", "NUMBA_CPU_FEATURES": "+avx2,+fma,+bmi,+bmi2,+f16c,+lzcnt,+movbe"}

# Classes of processors to what LLVM shall know of them beside. Wide registers slow some of them down.
PROCESSORS = {"x86-64-v3": "", "x86-64-v4": "+prefer-256-bit"}


def main() -> None:
    """Compile in a program of its own: numba reads the class of processors as it starts."""
    command = [sys.executable, "-m", "benchmarks.precompile", "here"]
    subprocess.run(command, env=os.environ | _NUMBA, check=True)


def compile_here() -> None:
    """Run everything, and compile what was called."""
    from benchmarks.kernel_library import build
    from bokehnet.precompiled.kernel import KERNELS, record_calls

    with tempfile.TemporaryDirectory() as folder, record_calls():
        _run_everything(Path(folder))
    called = [kernel for kernel in KERNELS.values() if kernel.called]
    for line in build(called, _FOLDER, PROCESSORS):
        print(f"left to numba: {line}")
    print(f"{len(called)} kernels for {', '.join(PROCESSORS)}")


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
    main() if len(sys.argv) == 1 else compile_here()
