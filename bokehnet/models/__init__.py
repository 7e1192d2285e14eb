"""Networks, their checkpoints and their ONNX export. Needs torch: pip install 'bokehnet[train]'."""

from bokehnet.checks import require_extra

require_extra("torch", "train")
