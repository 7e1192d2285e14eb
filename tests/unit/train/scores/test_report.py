import json
import math

import pytest

from train.scores.report import Row, as_json, differences, excess, format_table, mean_rows


def _rows():
    values = {"clean": 40, "blurred": 36, "eroded": 30, "dilated": 33}
    return [
        Row(method=method, disparity=kind, scores={"psnr": value + extra + noise, "flip": math.nan})
        for method, extra in (("rays", 0), ("hybrid", 2))
        for kind, value in values.items()
        for noise in (-1, 1)
    ]


def test_means_are_over_pictures_and_corrupted_over_three_kinds():
    means = {(row.method, row.disparity): row.scores["psnr"] for row in mean_rows(_rows())}
    assert means["rays", "clean"] == 40
    assert means["rays", "degraded"] == pytest.approx(33)
    assert means["hybrid", "degraded"] == pytest.approx(35)
    order = [row.disparity for row in mean_rows(_rows())]
    assert order == [kind for kind in ("clean", "blurred", "eroded", "dilated", "degraded") for _ in "ab"]


def test_pictures_without_a_score_do_not_count():
    rows = [Row(method="rays", disparity="clean", scores={"psnr": x}) for x in (30.0, math.nan, 34.0)]
    (mean,) = mean_rows(rows)
    assert mean.scores["psnr"] == 32


def test_corrupted_needs_all_three():
    rows = [row for row in _rows() if row.disparity != "eroded"]
    assert "degraded" not in {row.disparity for row in mean_rows(rows)}


def test_excess_takes_the_noise_of_the_truth_off():
    """Authority: a render with twice the noise's error errs as much as the noise by itself."""
    rows = [Row(method="rays", disparity="clean", scores={"psnr": 40 - 10 * math.log10(2), "edge_psnr": 41})]
    (row,) = excess(rows, {"psnr": 40, "edge_psnr": 40})
    assert row.scores["excess_psnr"] == pytest.approx(40)
    assert math.isnan(row.scores["excess_edge_psnr"])


def test_differences_are_to_the_baseline_on_the_same_disparity():
    rows = differences(mean_rows(_rows()), "rays")
    assert {row.method for row in rows} == {"hybrid"}
    assert [row.scores["psnr"] for row in rows] == pytest.approx([2] * 5)


def test_tables_omit_empty_columns():
    rows = mean_rows(_rows())[:2]
    assert format_table("all", ("psnr", "flip"), rows, markdown=False).splitlines() == [
        "all",
        "method  disparity   psnr",
        "rays    clean      40.00",
        "hybrid  clean      42.00",
    ]
    markdown = format_table("all", ("psnr", "flip"), rows, markdown=True, signed=True)
    assert markdown.splitlines() == [
        "**all**",
        "",
        "| method | disparity | psnr |",
        "| --- | --- | ---: |",
        "| rays | clean | +40.00 |",
        "| hybrid | clean | +42.00 |",
    ]
    assert format_table("none", ("flip",), rows, markdown=False) == ""


def test_json_has_no_nan():
    (row,) = as_json([Row(method="rays", disparity="clean", scores={"psnr": 1.5, "flip": math.nan})])
    assert json.loads(json.dumps(row, allow_nan=False)) == {
        "method": "rays",
        "disparity": "clean",
        "psnr": 1.5,
        "flip": None,
    }
