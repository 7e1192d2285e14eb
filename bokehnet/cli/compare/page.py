"""Self-contained web page that compares any two of several pictures with a slider."""

import base64
import html
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from bokehnet.io.image import write_image
from bokehnet.tools.comparison import EngineComparison

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
<p><input id="slider" type="range" min="0" max="100" value="50" aria-label="boundary of the pictures"></p>
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


def comparison_page(
    image: np.ndarray, results: Sequence[EngineComparison], truth: np.ndarray | None = None
) -> str:
    """Return the page as HTML.

    Args:
        image: All-in-focus picture, scene-linear, (H, W, 3).
        results: Results of the engines.
        truth: Reference picture, scene-linear, (H, W, 3).
    """
    shown = {"in focus": image} | ({} if truth is None else {"truth": truth})
    shown |= {result.engine: result.bokeh for result in results}
    pictures = ",\n".join(f'"{html.escape(name)}": "{_data(picture)}"' for name, picture in shown.items())
    return _PAGE.format(rows="\n".join(_row(result) for result in results), pictures=pictures)


def _row(result: EngineComparison) -> str:
    numbers = ["", "", "", ""]
    if result.scores is not None:
        scores = result.scores
        numbers = [
            f"{scores.psnr:.2f}",
            f"{scores.edge_psnr:.2f}",
            f"{scores.ssim:.4f}",
            f"{scores.flip:.4f}",
        ]
    cells = [html.escape(result.engine), *numbers, f"{result.seconds:.2f}"]
    cells.append("" if result.memory is None else f"{result.memory / 1e6:.0f}")
    return "<tr>" + "".join(f"<td>{cell}</td>" for cell in cells) + "</tr>"


def _data(picture: np.ndarray) -> str:
    """Return a picture as a data URL of an 8-bit PNG."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "picture.png"
        write_image(path, np.clip(picture, 0, 1).astype(np.float32))
        return "data:image/png;base64," + base64.b64encode(path.read_bytes()).decode("ascii")
