"""Write the colour tables that decode maps in false colours: ``python -m tools.color_tables``.

The tables come from matplotlib: viridis, plasma, inferno and magma (Nathaniel Smith, Stefan van der Walt and
Eric Firing, 2015, CC0), turbo (Anton Mikhailov, "Turbo, an improved rainbow colormap", 2019, Apache-2.0), jet
(the piecewise linear formula of matplotlib) and Spectral (Cynthia Brewer, ColorBrewer, Apache-2.0), reversed
as the demonstrations of depth networks use it.
"""

import numpy as np

from bokehnet.io.depth.false_colors import COLOR_MAPS, TABLES_FILE

_LEVELS = 256


def color_tables() -> np.ndarray:
    """Return the colours of all maps at 256 values from 0 to 1, (maps, 256, 3), uint8."""
    import matplotlib  # optional dependency

    values = np.linspace(0, 1, _LEVELS)
    colors = [matplotlib.colormaps[name](values)[:, :3] for name in COLOR_MAPS]
    tables: np.ndarray = np.rint(255 * np.asarray(colors)).astype(np.uint8)
    return tables


if __name__ == "__main__":
    np.save(TABLES_FILE, color_tables())
