"""Reports on a lens: cardinal points, curves, plots and sheets."""
