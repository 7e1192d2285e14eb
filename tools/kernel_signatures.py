"""Rewrite the list of precompiled kernels: ``python -m tools.kernel_signatures``.

The command runs the command lines of the golden set (:mod:`benchmarks.golden`) and the demo, and records the
argument types of all kernel calls. It is needed to precompile a new kernel or a new argument type; until then
numba compiles at the first call. Listed kernels that exist but that these commands do not call stay listed.
"""

import os
import tempfile
from importlib import import_module
from pathlib import Path

from tools.kernel_library import SIGNATURES, kernel_modules, read_signatures, short_name

_HEAD = "# Kernels that are compiled ahead, and types of their arguments; python -m tools.kernel_signatures\n"


def main() -> None:
    """Run all commands and write the recorded signatures."""
    from bokehnet.precompiled.kernel import KERNELS, record_calls

    with tempfile.TemporaryDirectory() as folder, record_calls():
        _run_everything(Path(folder))
    called = {
        (short_name(kernel.name), description) for kernel in KERNELS.values() for description in kernel.called
    }
    names, modules = {name for name, _ in called}, kernel_modules()
    for name, description in read_signatures():
        module, function = name.split(".")
        if name not in names and hasattr(import_module(modules.get(module, "builtins")), function):
            called.add((name, description))
    lines = [f"{name} {description}\n" for name, description in sorted(called)]
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
