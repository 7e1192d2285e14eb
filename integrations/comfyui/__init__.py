"""ComfyUI nodes for the bokeh of a lens: put this folder, or a link to it, into ComfyUI's custom_nodes.

Install the package with `pip install bokehnet` in ComfyUI's own Python. Pictures are IMAGE tensors (frames,
height, width, 3), sRGB 0 to 1, as in all nodes; disparity is an IMAGE in which bright is near.
"""

from .depth_nodes import BokehDepthRepair, BokehFocusPicker
from .error_node import BokehExpectedError
from .look_nodes import BokehLook
from .render_nodes import BokehRender
from .save_node import BokehSave
from .video_node import BokehVideo

_NODES = {
    "BokehRender": (BokehRender, "Bokeh Render"),
    "BokehFocusPicker": (BokehFocusPicker, "Bokeh Focus Picker"),
    "BokehLook": (BokehLook, "Bokeh Lens / Preset"),
    "BokehDepthRepair": (BokehDepthRepair, "Bokeh Depth Repair"),
    "BokehExpectedError": (BokehExpectedError, "Bokeh Expected Error"),
    "BokehVideo": (BokehVideo, "Bokeh Video"),
    "BokehSave": (BokehSave, "Bokeh Save (16 bit, EXR)"),
}
NODE_CLASS_MAPPINGS = {name: node for name, (node, _) in _NODES.items()}
NODE_DISPLAY_NAME_MAPPINGS = {name: title for name, (_, title) in _NODES.items()}

__all__ = ["NODE_CLASS_MAPPINGS", "NODE_DISPLAY_NAME_MAPPINGS"]
