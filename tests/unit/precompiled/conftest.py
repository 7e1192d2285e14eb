import pytest

from tools.kernel_library import build, read_signatures


@pytest.fixture(scope="session")
def built(tmp_path_factory):
    """A library of a few kernels that compile fast, made as the build of a wheel makes it."""
    folder = tmp_path_factory.mktemp("machine_code")
    expected = ("error_map.", "depth_discontinuities._discontinuity_sides ")
    signatures = [pair for pair in read_signatures() if " ".join(pair).startswith(expected)]
    assert build(folder, signatures, processes=1) == []
    return folder
