"""Static HTML page of results: the leaderboard, and pictures of any two methods behind a slider."""

import html
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from bokeh_bench import VERSION
from bokeh_bench.files import BenchError, read_picture, write_png
from bokeh_bench.leaderboard import table

__all__ = ["write_page"]

_STYLE = """
body { font: 16px system-ui, sans-serif; margin: 2rem auto; max-width: 70rem; padding: 0 1rem; }
table { border-collapse: collapse; display: block; overflow-x: auto; font-variant-numeric: tabular-nums; }
td, th { padding: .25rem .6rem; text-align: right; border-bottom: 1px solid #ccc; }
td:first-child, th:first-child { text-align: left; }
.pair { position: relative; width: 100%; max-width: 960px; aspect-ratio: 4 / 3; }
.pair img { position: absolute; inset: 0; width: 100%; height: 100%; image-rendering: pixelated; }
label { margin-right: 1rem; }
input[type=range] { width: 100%; max-width: 960px; }
@media (prefers-color-scheme: dark) { body { background: #181818; color: #ddd; } }
"""

_SCRIPT = """
const data = JSON.parse(document.getElementById('data').textContent);
const pick = name => document.getElementById(name);
function fill(select, values) {
  for (const value of values) select.add(new Option(value, value));
}
fill(pick('scene'), data.scenes); fill(pick('track'), data.tracks);
fill(pick('left'), data.methods); fill(pick('right'), data.methods);
pick('left').value = 'truth';
pick('right').value = data.methods[1];
function name(method) {
  const scene = pick('scene').value;
  const end = method === 'truth' ? '' : `_${pick('track').value}`;
  return `pictures/${method}_${scene}${end}.png`;
}
function show() {
  pick('a').src = name(pick('left').value); pick('b').src = name(pick('right').value); wipe();
}
function wipe() { pick('b').style.clipPath = `inset(0 0 0 ${pick('wipe').value}%)`; }
for (const id of ['scene', 'track', 'left', 'right']) pick(id).onchange = show;
pick('wipe').oninput = wipe; show();
"""


def _html_table(markdown: str) -> str:
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in markdown.splitlines()]
    head = "".join(f"<th>{html.escape(cell)}</th>" for cell in rows[0])
    body = "".join(
        "<tr>" + "".join(f"<td>{html.escape(cell)}</td>" for cell in row) + "</tr>" for row in rows[2:]
    )
    return f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"


def write_page(results: Sequence[dict[str, Any]], scenes: Path, pictures: Path, out: Path) -> Path:
    """Write ``index.html`` and its pictures to a folder, and return the path of the page.

    Args:
        results: Results of the methods to show.
        scenes: Folder of the scenes, for the truths.
        pictures: Folder that ``run --pictures`` wrote for these methods.
        out: Folder of the page.

    Raises:
        BenchError: A picture of a method is missing.
    """
    (out / "pictures").mkdir(parents=True, exist_ok=True)
    tracks = [track for track in results[0]["tracks"] if all(track in each["tracks"] for each in results)]
    shots = list(dict.fromkeys(f"{row['scene']}_{row['shot']}" for row in results[0]["rows"]))
    for shot in shots:
        scene, number = shot.rsplit("_", 1)
        write_png(out / f"pictures/truth_{shot}.png", read_picture(scenes / scene / f"truth_{number}.pfm"))
        for result in results:
            for track in tracks:
                name = f"{result['method']}_{shot}_{track}.png"
                if not (pictures / name).exists():
                    raise BenchError(f"{pictures / name}: expected a picture of `run --pictures`; found none")
                (out / "pictures" / name).write_bytes((pictures / name).read_bytes())
    data = {"scenes": shots, "tracks": tracks, "methods": ["truth", *(each["method"] for each in results)]}
    selects = "".join(
        f'<label>{title} <select id="{key}"></select></label>'
        for key, title in (
            ("scene", "Scene and shot"),
            ("track", "Track"),
            ("left", "Left"),
            ("right", "Right"),
        )
    )
    content = f"""<!doctype html>
<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width">
<title>bokeh-bench {VERSION}</title><style>{_STYLE}</style></head><body>
<h1>bokeh-bench, version {VERSION}</h1>
<p>Edge PSNR in dB for each track, then PSNR, SSIM, FLIP (0 is best) and light of the first track.</p>
{_html_table(table(results))}
<h2>Pictures</h2><p>{selects}</p>
<p><input type="range" id="wipe" min="0" max="100" value="50" aria-label="Boundary of the two pictures"></p>
<div class="pair"><img id="a" alt="left picture"><img id="b" alt="right picture"></div>
<script type="application/json" id="data">{json.dumps(data).replace("<", "&lt;")}</script>
<script>{_SCRIPT}</script></body></html>
"""
    (out / "index.html").write_text(content, encoding="utf-8")
    return out / "index.html"
