"""Plot of a file of figures over the size in its rows' names: ``python -m benchmarks.plots FIGURES PLOT``.

Rows begin with a number, such as "131,072 triangles" or "24 megapixels"; both axes are logarithmic.
``--columns NAME ...`` selects the lines. The same file gives the same SVG picture.
"""

import argparse
import json
from pathlib import Path

__all__ = ["plot_figures"]


def plot_figures(figures: Path, plot: Path, columns: list[str] | None = None, axis: str = "") -> None:
    """Draw columns of a file of figures over the number at the beginning of each row's name.

    Args:
        figures: File of :func:`benchmarks.figures.write_figures`.
        plot: Picture file; its ending selects the format.
        columns: Columns to draw; default: all.
        axis: Title of the horizontal axis; default: what follows the number.
    """
    import matplotlib.pyplot as plt  # optional dependency

    table = json.loads(figures.read_text())
    sizes = {float(name.split()[0].replace(",", "")): row for name, row in table["rows"].items()}
    plt.rcParams["svg.hashsalt"] = plot.stem
    figure, axes = plt.subplots(figsize=(5, 3.5), layout="constrained")
    for column in columns or table["columns"]:
        points = [(size, row[column]) for size, row in sorted(sizes.items()) if column in row]
        if points:
            title = table["columns"][column]["title"].removesuffix(", s").replace("`", "")
            axes.loglog(*zip(*points, strict=True), marker="o", label=title)
    axes.set_xlabel(axis or next(iter(table["rows"])).split(maxsplit=1)[1])
    axes.set_ylabel("processor seconds")
    axes.set_xticks(sorted(sizes), labels=[_short(size) for size in sorted(sizes)], minor=False)
    axes.set_xticks([], minor=True)
    axes.grid(True, which="major", alpha=0.3)
    axes.legend()
    figure.savefig(plot, metadata={"Date": None} if plot.suffix == ".svg" else None)
    plt.close(figure)


def _short(size: float) -> str:
    for letter, unit in (("M", 1e6), ("k", 1e3)):
        if size >= unit:
            return f"{size / unit:.3g}{letter}"
    return f"{size:g}"


def main() -> None:
    """Entry of the command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("figures", type=Path)
    parser.add_argument("plot", type=Path)
    parser.add_argument("--columns", nargs="*")
    parser.add_argument("--axis", default="", help="title of the horizontal axis")
    arguments = parser.parse_args()
    plot_figures(arguments.figures, arguments.plot, arguments.columns, arguments.axis)


if __name__ == "__main__":
    main()
