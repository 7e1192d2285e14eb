import pytest
import torch
from torch.testing import assert_close

from bokehnet.classical.torch.autograd import scatter_sums as numba_sums
from bokehnet.classical.torch.pyramid_levels import scatter_sums as torch_sums


def test_importing_it_leaves_the_compiler_alone(python_process):
    source = "import sys, bokehnet.classical.torch.autograd; sys.exit('torch._dynamo' in sys.modules)"
    assert python_process(source).code == 0


@pytest.mark.parametrize("scatter", [numba_sums, torch_sums], ids=["numba", "torch"])
def test_a_compiled_program_gives_the_same_picture_and_gradient(scatter):
    """Oracle: the program as it is. Inside, numba runs or sizes depend on the data: nothing to trace."""
    image = torch.rand((20, 24, 3), generator=torch.Generator().manual_seed(0), requires_grad=True)
    defocus = torch.linspace(-3, 4, 480).reshape(20, 24)

    def program(image):
        return scatter(2 * image, defocus).square()

    compiled = torch.compile(program, backend="eager")
    results = [torch.autograd.grad(run(image).sum(), image)[0] for run in (program, compiled)]
    assert_close(compiled(image), program(image))
    assert_close(*results)
