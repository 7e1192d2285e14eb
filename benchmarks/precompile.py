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

# Class of processors to what LLVM may use of it.
PROCESSORS = {"x86-64-v3": "+avx2,+fma,+bmi,+bmi2,+f16c,+lzcnt,+movbe,+popcnt,+sse4.2"}


def main() -> None:
    """Compile for each class of processors, in programs of their own: numba reads the class as it starts."""
    for processor, features in PROCESSORS.items():
        environment = {"NUMBA_CPU_NAME": processor, "NUMBA_CPU_FEATURES": features}
        command = [sys.executable, "-m", "benchmarks.precompile", processor]
        subprocess.run(command, env=os.environ | environment, check=True)


def compile_for(processor: str) -> None:
    """Run everything, and compile what was called; numba must have been started for this class."""
    from benchmarks.kernel_library import build
    from bokehnet.precompiled.kernel import KERNELS, record_calls

    with tempfile.TemporaryDirectory() as folder, record_calls():
        _run_everything(Path(folder))
    called = [kernel for kernel in KERNELS.values() if kernel.called]
    for line in build(called, _FOLDER, processor, PROCESSORS[processor]):
        print(f"left to numba: {line}")
    print(f"{len(called)} kernels for {processor}")


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
    main() if len(sys.argv) == 1 else compile_for(sys.argv[1])
