"""Build hook of wheels: compiles the kernels ahead (``tools/kernel_library.py``) and packs the machine code.

Where that fails for any reason, a wheel for all platforms is built, without machine code, and numba compiles
the kernels at their first use. ``BOKEHNET_BUILD_KERNELS=0`` builds such a wheel at once. Editable installs
get no machine code: kernels are edited there.
"""

import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

from packaging import tags

SWITCH = "BOKEHNET_BUILD_KERNELS"
TARGET = "bokehnet/precompiled/machine_code"


class KernelHook(BuildHookInterface):
    """Compile before a wheel is packed, remove the compiled files after it."""

    _folder: Any = None

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Add machine code, and the tag of the platform and version of Python that it is for.

        Keys of machine code cover the bytecode, which belongs to one minor version of Python.
        """
        if version == "editable" or os.environ.get(SWITCH, "1") == "0":
            return
        self._folder = tempfile.TemporaryDirectory(prefix="bokehnet-kernels-")
        folder = Path(self._folder.name)
        try:
            _compile(Path(self.root), folder)
        except Exception as error:  # the package works without
            print(
                f"bokehnet: warning: no machine code is packed, kernels are compiled at first use: {error}",
                file=sys.stderr,
            )
            return
        for path in folder.iterdir():
            build_data["force_include"][str(path)] = f"{TARGET}/{path.name}"
        build_data["pure_python"] = False
        build_data["tag"] = f"{tags.interpreter_name()}{tags.interpreter_version()}-none-{_platform()}"

    def finalize(self, version: str, build_data: dict[str, Any], artifact_path: str) -> None:
        """Remove the compiled files."""
        if self._folder is not None:
            self._folder.cleanup()


def _compile(root: Path, folder: Path) -> None:
    """Run the compiler in a process of its own, which imports the package from here."""
    paths = [str(root), *filter(None, [os.environ.get("PYTHONPATH")])]  # pip's own, with what a build needs
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(paths)}
    command = [sys.executable, "-m", "tools.kernel_library", str(folder)]
    done = subprocess.run(command, cwd=root, env=environment, check=False, stdout=sys.stderr)
    if done.returncode:
        raise OSError(f"tools.kernel_library ended with code {done.returncode}")


def _platform() -> str:
    """Return the tag of the platform.

    Machine code links to no library of the system, so on Linux the oldest glibc that numba supports will do.
    """
    platforms = list(tags.platform_tags())
    return next((name for name in platforms if name.startswith("manylinux_2_17_")), platforms[0])
