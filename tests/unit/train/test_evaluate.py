import json
from pathlib import Path

import numpy as np
import pytest

from bokehnet.errors import ParameterError
from bokehnet.render.renderer import BokehRenderer
from train.data.degradation import degrade
from train.evaluate import evaluate, main
from train.scores import methods
from train.scores.evaluation_sets import list_pictures
from train.scores.methods import parse_method
from train.scores.metrics import compare, edge_pixels, encode, psnr


def test_methods_are_read_as_they_are_written():
    assert parse_method("rays").repair is None
    method = parse_method("hybrid:runs/x/weights+repair")
    assert (method.engine, method.weights, method.repair) == (
        "hybrid",
        Path("runs/x/weights"),
        "repair",
    )
    assert parse_method("rays+repair").repair == "repair"
    assert parse_method("rays+refine").repair == "repair"  # as earlier versions called it
    for wrong in ("lens", "rays+mend", "+repair", "rays+", ""):
        with pytest.raises(ParameterError, match="expected one of"):
            parse_method(wrong)


def test_scores_are_of_the_corrupted_render_by_the_true_edges(tiny_pairs):
    """Authority: the shipped renderer and ``compare``, by hand."""
    picture = list_pictures("shards", tiny_pairs)[0]
    shot = picture.read()
    ((clean, eroded),) = evaluate([picture], [parse_method("rays")], ["clean", "eroded"])
    for row, defocus in ((clean, shot.defocus), (eroded, degrade(shot.defocus, "eroded"))):
        render = BokehRenderer("rays").render_arrays(shot.image, defocus).bokeh
        for key, value in compare(render, shot.truth, shot.defocus).items():
            assert row.scores[key] == pytest.approx(value), key
    assert eroded.scores["psnr"] != clean.scores["psnr"]


def test_the_disparity_is_repaired_once_for_all_methods(tiny_pairs, monkeypatch):
    """A repair that knows the truth makes of every disparity the clean one."""
    picture = list_pictures("shards", tiny_pairs)[0]
    true, calls = picture.read().defocus, []

    def perfect(image, disparity):
        calls.append(disparity)
        return true

    monkeypatch.setitem(methods.REPAIRS, "perfect", perfect)
    ways = [parse_method(text) for text in ("scatter", "scatter+perfect", "rays+perfect")]
    (rows,) = evaluate([picture], ways, ["clean", "dilated"])
    scores = {(row.method, row.disparity): row.scores["psnr"] for row in rows}
    assert scores["scatter+perfect", "dilated"] == scores["scatter", "clean"]
    assert scores["scatter", "dilated"] != scores["scatter", "clean"]
    assert len(calls) == 2
    np.testing.assert_array_equal(calls[1], degrade(true, "dilated"))


def test_the_hybrid_is_held_against_its_classical_half(tiny_pairs, random_weights):
    picture = list_pictures("shards", tiny_pairs)[0]
    ((row,),) = evaluate([picture], [parse_method(f"fast:{random_weights}")], ["clean"])
    shot = picture.read()
    result = BokehRenderer("fast", weights=random_weights).render_arrays(shot.image, shot.defocus)
    flat = ~edge_pixels(shot.defocus)
    assert flat.sum() >= 100
    error = ((encode(result.bokeh) - encode(result.classical)) ** 2)[flat]
    assert row.scores["flat_psnr_like"] == pytest.approx(psnr(error))


def test_processes_change_nothing(tiny_pairs):
    pictures, ways = list_pictures("shards", tiny_pairs, 2), [parse_method("scatter")]
    done = []
    together = evaluate(pictures, ways, ["clean"], jobs=2, progress=done.append)
    assert done == [1, 2, 3, 4]
    for one, other in zip(together, evaluate(pictures, ways, ["clean"]), strict=True):
        np.testing.assert_equal(one[0].scores, other[0].scores)


def test_the_command_prints_tables_and_writes_all_scores(tiny_pairs, tmp_path, capsys):
    file = tmp_path / "scores.json"
    line = ["--data", "shards", tiny_pairs, "--method", "scatter", "--method", "rays", "--limit", "1"]
    line += ["--baseline", "scatter", "--noise-floor", "60", "60", "--json", file, "--markdown"]
    main([str(word) for word in line])
    out = capsys.readouterr().out
    assert "| rays | degraded |" in out
    assert "**edge pixels, less scatter**" in out
    assert "excess_edge_psnr" in out
    scores = json.loads(file.read_text())
    assert len(scores["pictures"]) == 2
    assert {row["disparity"] for row in scores["means"]} >= {"clean", "quantised", "degraded"}
    rows = [row for picture in scores["pictures"] for row in picture["rows"]]
    of_rays = [row["psnr"] for row in rows if row["method"] == "rays" and row["disparity"] == "clean"]
    (mean,) = [row for row in scores["means"] if (row["method"], row["disparity"]) == ("rays", "clean")]
    assert mean["psnr"] == pytest.approx(np.mean(of_rays))
    assert f"| rays | clean | {mean['psnr']:.2f} |" in out


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--data", "photos", "."], "kind: expected one of blb"),
        (["--data", "cycles", "nowhere"], "nowhere: expected pictures of a cycles set"),
        (["--data", "shards", "nowhere"], "expected the description of a data set"),
        (["--data", "cycles", ".", "--method", "lens"], "--method: expected one of"),
        (["--data", "cycles", ".", "--disparity", "wet"], "--disparity: expected one of"),
        (["--data", "blb", "BLB", "--method", "hybrid:nowhere"], "network weights missing"),
        (["--data", "cycles", ".", "--limit", "0"], "--limit: expected at least 1, got 0"),
        (["--data", "cycles", ".", "--baseline", "lens"], "--baseline: expected one of"),
        (["--data", "cycles", ".", "--noise-floor", "nan", "1"], "--noise-floor: expected a finite number"),
        (["--data", "cycles", ".", "--json", "nowhere/a.json"], "there is no folder nowhere"),
    ],
)
def test_mistakes_are_one_line(words, message, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    folder = tmp_path / "BLB" / "0"
    folder.mkdir(parents=True)
    (folder / "info.json").write_text('{"blur_parameters": [1], "focus_distances": [1]}')
    (folder / "bokeh_00_00.exr").touch()
    with pytest.raises(SystemExit) as caught:
        main(words)
    assert str(caught.value.code).startswith("error: ")
    assert message in str(caught.value.code)
    assert "\n" not in str(caught.value.code)
