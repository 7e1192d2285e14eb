"""Classical renderers: bokeh without learned parts, as NumPy functions and numba kernels."""
