"""The Python of docs/use/torch.md runs as printed."""

import re
from pathlib import Path

import pytest

torch = pytest.importorskip("torch", reason="needs the extra torch")

from bokehnet.torch import BokehBlur  # noqa: E402

PAGE = Path(__file__).parents[3] / "docs/use/torch.md"
BLOCKS = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)


@pytest.mark.slow
def test_the_first_example_returns_two_pictures():
    names: dict = {}
    smaller = BLOCKS[0].replace("240, 320", "24, 32")
    exec(compile(smaller, str(PAGE), "exec"), names)
    assert names["fast"].shape == names["bokeh"].shape == names["image"].shape
    assert torch.isfinite(names["bokeh"]).all()


@pytest.mark.slow
def test_the_training_loop_lowers_its_loss():
    """Authority: the loss of the first steps."""
    torch.manual_seed(0)
    sharp, disparity = torch.rand(1, 3, 24, 28), torch.full((1, 1, 24, 28), 0.4)
    disparity[..., 8:16, 8:20] = 0.9
    with torch.no_grad():
        bokeh = BokehBlur(blur=12.0, focus=0.4, samples=8)(sharp, disparity)
    losses: list[float] = []

    def pairs():
        for _ in range(12):
            yield sharp, bokeh
            losses.append(names["loss"].item())

    names: dict = {"pairs": pairs()}
    exec(compile(BLOCKS[1], str(PAGE), "exec"), names)
    assert len(losses) == 12
    assert sum(losses[-3:]) < 0.99 * sum(losses[:3])
    assert names["blur"].focus.grad is not None
