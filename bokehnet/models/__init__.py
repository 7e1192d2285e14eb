"""The two networks and how they are stored and exported. Needs torch: pip install 'bokehnet[train]'."""

from bokehnet.checks import require_extra

require_extra("torch", "train")
