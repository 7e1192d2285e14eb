"""A renderer that has rendered works in children of its process, however they are started.

Each program renders with three engines, then in two children; a child must give the same bits. Children that
hang fail by the time limit of the program, which is no measurement: it is some twenty times what it takes.
"""

import os
import signal
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
LIMIT = 120  # s

COMMON = """
import hashlib, multiprocessing, os, sys
import numpy as np
import bokehnet

def picture():
    rng = np.random.default_rng(5)
    disparity = np.full((96, 120), 0.2, np.float32)
    disparity[20:70, 30:60] = 0.9
    return rng.random((96, 120, 3), dtype=np.float32), disparity

def digest(work):
    renderers, repair = work
    image, disparity = picture()
    arrays = {"image": image, "disparity": disparity, "blur": 12, "focus": 0.9}
    found = [renderer.render_arrays(**arrays).bokeh for renderer in renderers]
    found.append(repair(image, disparity))
    return hashlib.sha256(b"".join(map(np.ndarray.tobytes, found))).hexdigest()

def make():
    names = "scatter", "rays", "hybrid"
    return [bokehnet.BokehRenderer(name) for name in names], bokehnet.DisparityRepair()

if __name__ == "__main__":
    work = make()
    wanted = digest(work)
"""

POOL = """
    with multiprocessing.get_context("{0}").Pool(2) as pool:
        found = pool.map(digest, [work, work])
"""

EXECUTOR = """
    from concurrent.futures import ProcessPoolExecutor
    with ProcessPoolExecutor(2, multiprocessing.get_context("{0}")) as pool:
        found = list(pool.map(digest, [work, work]))
"""

JOBLIB = """
    from joblib import Parallel, delayed
    found = Parallel(2)(delayed(digest)(one) for one in (work, work))
"""

LOADER = """
    from torch.utils.data import DataLoader, Dataset
    class Rendered(Dataset):
        def __len__(self):
            return 2
        def __getitem__(self, index):
            return digest(work)
    found = [one[0] for one in DataLoader(Rendered(), num_workers=2)]
"""

# As servers do that load everything before they fork; the children end as any program does.
PREFORK = """
    found = []
    for _ in range(2):
        mine, theirs = os.pipe()
        if os.fork() == 0:
            os.write(theirs, digest(work).encode())
            sys.exit()
        found.append(os.read(mine, 64).decode())
        assert os.wait()[1] == 0
"""

# A child that renders nothing must end, too.
IDLE = """
    if os.fork() == 0:
        sys.exit()
    assert os.wait()[1] == 0
    found = [digest(work)] * 2
"""

# Another thread holds the locks of a renderer and of the kernels while the process is forked.
BUSY = """
    import threading
    going = True
    def keep_busy():
        while going:
            digest(work)
    thread = threading.Thread(target=keep_busy)
    thread.start()
    with multiprocessing.get_context("fork").Pool(2) as pool:
        found = pool.map(digest, [work, work])
    going = False
    thread.join()
"""

WAYS = {
    "pool by fork": POOL.format("fork"),
    "pool by spawn": POOL.format("spawn"),
    "executor by fork": EXECUTOR.format("fork"),
    "executor by forkserver": EXECUTOR.format("forkserver"),
    "joblib": JOBLIB,
    "torch's loader": LOADER,
    "server": PREFORK,
    "idle child": IDLE,
    "busy parent": BUSY,
}


def run_program(folder: Path, source: str, limit: float = LIMIT, **variables: str) -> tuple[int, str]:
    """Exit code and stderr of a program; it and all its children end after so many seconds."""
    path = folder / "program.py"
    path.write_text(source)
    search = os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH")]))
    process = subprocess.Popen(
        [sys.executable, path],
        env={**os.environ, "PYTHONPATH": search, **variables},
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    try:
        _, output = process.communicate(timeout=limit)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        pytest.fail(f"hung: {process.communicate()[1]}")
    return process.returncode, output


@pytest.fixture(scope="module", autouse=True)
def _compiled(tmp_path_factory):
    """Kernels are compiled before any time is limited."""
    code, output = run_program(tmp_path_factory.mktemp("first"), COMMON, limit=580)
    assert code == 0, output


@pytest.mark.skipif(not hasattr(os, "fork"), reason="this system cannot fork")
@pytest.mark.parametrize("way", WAYS)
def test_children_of_a_process_that_rendered_give_the_same_bits(tmp_path, way):
    for module in ("joblib", "torch"):
        if module in WAYS[way] and find_spec(module) is None:
            pytest.skip(f"needs {module}, which is not installed")
    source = COMMON + WAYS[way] + "    assert found == [wanted, wanted], (found, wanted)\n"
    code, output = run_program(tmp_path, source)
    assert code == 0, output


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="GNU OpenMP is Linux's")
def test_a_layer_that_does_not_outlive_a_fork_is_refused_in_words(tmp_path):
    """Whoever asks for OpenMP gets it; a child then fails with an error in place of a signal."""
    pytest.importorskip("numba.np.ufunc.omppool")
    source = COMMON + (
        "    if os.fork() == 0:\n"
        "        try:\n"
        "            digest(work)\n"
        "        except bokehnet.BokehnetError as error:\n"
        "            os._exit(7 if 'NUMBA_THREADING_LAYER' in str(error) else 1)\n"
        "    assert os.waitstatus_to_exitcode(os.wait()[1]) == 7\n"
    )
    code, output = run_program(tmp_path, source, NUMBA_THREADING_LAYER="omp")
    assert code == 0, output
