"""A page, complete in one file, that lays any two of some pictures over each other with a slider."""

import base64
import html
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from bokehnet.io.image import write_image
from bokehnet.tools.comparison import Compared

__all__ = ["comparison_page"]

_PAGE = """<!doctype html>
<html lang="en"><meta charset="utf-8"><title>bokehnet compare</title>
<style>
body {{ background: #222; color: #ddd; font: 15px sans-serif; margin: 1.5em; }}
#both {{ position: relative; display: inline-block; line-height: 0; }}
#both img {{ max-width: 100%; }}
#over {{ position: absolute; left: 0; top: 0; }}
input[type=range] {{ width: 100%; }}
td, th {{ padding: 0.2em 1em 0.2em 0; text-align: right; }}
td:first-child, th:first-child {{ text-align: left; }}
</style>
<p>Left <select id="left"></select> Right <select id="right"></select></p>
<div id="both"><img id="under" alt=""><img id="over" alt=""></div>
<p><input id="slider" type="range" min="0" max="100" value="50" aria-label="where the left picture ends"></p>
<table>
<tr><th>engine</th><th>PSNR</th><th>edge PSNR</th><th>SSIM</th><th>FLIP</th><th>seconds</th><th>MB</th></tr>
{rows}</table>
<script>
const pictures = {{{pictures}}};
const at = id => document.getElementById(id);
for (const side of ["left", "right"]) {{
  for (const name of Object.keys(pictures)) at(side).add(new Option(name, name));
  at(side).onchange = show;
}}
at("right").selectedIndex = at("right").length - 1;
at("slider").oninput = show;
function show() {{
  at("under").src = pictures[at("right").value];
  at("over").src = pictures[at("left").value];
  at("over").style.clipPath = `inset(0 ${{100 - at("slider").value}}% 0 0)`;
}}
show();
</script>
</html>
"""


def comparison_page(image: np.ndarray, found: Sequence[Compared], truth: np.ndarray | None = None) -> str:
    """Return the page as HTML.

    Args:
        image: The picture, scene-linear, (H, W, 3).
        found: What the engines made of it.
        truth: Scene-linear, (H, W, 3).
    """
    shown = {"in focus": image} | ({} if truth is None else {"truth": truth})
    shown |= {one.engine: one.bokeh for one in found}
    pictures = ",\n".join(f'"{html.escape(name)}": "{_data(picture)}"' for name, picture in shown.items())
    return _PAGE.format(rows="\n".join(_row(one) for one in found), pictures=pictures)


def _row(one: Compared) -> str:
    numbers = ["", "", "", ""]
    if one.scores is not None:
        told = one.scores
        numbers = [f"{told.psnr:.2f}", f"{told.edge_psnr:.2f}", f"{told.ssim:.4f}", f"{told.flip:.4f}"]
    cells = [html.escape(one.engine), *numbers, f"{one.seconds:.2f}"]
    cells.append("" if one.memory is None else f"{one.memory / 1e6:.0f}")
    return "<tr>" + "".join(f"<td>{cell}</td>" for cell in cells) + "</tr>"


def _data(picture: np.ndarray) -> str:
    """A picture as a PNG of 8 bits inside a URL."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "picture.png"
        write_image(path, np.clip(picture, 0, 1).astype(np.float32))
        return "data:image/png;base64," + base64.b64encode(path.read_bytes()).decode("ascii")
