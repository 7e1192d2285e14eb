"""Node that saves more than 8 bits: PNG and TIFF with 16 bits, EXR with unclipped light."""

from pathlib import Path
from typing import Any, ClassVar

import folder_paths
import numpy as np

from bokehnet.io.image import write_image

from .host import CATEGORY, node_errors


class BokehSave:
    """Writes unclipped light of Bokeh Render into ComfyUI's output folder."""

    CATEGORY: ClassVar[str] = CATEGORY
    FUNCTION: ClassVar[str] = "save"
    RETURN_TYPES: ClassVar[tuple[str, ...]] = ()
    OUTPUT_NODE: ClassVar[bool] = True

    @classmethod
    def INPUT_TYPES(cls) -> dict[str, Any]:  # noqa: N802
        """See ComfyUI."""
        return {
            "required": {
                "light": ("BOKEH_LIGHT",),
                "filename_prefix": ("STRING", {"default": "bokeh"}),
                "format": (["exr", "png", "tif"],),
            }
        }

    def save(self, light: list[np.ndarray], filename_prefix: str, format: str) -> dict[str, Any]:
        """Write a file for each picture, with ComfyUI's numbering."""
        with node_errors():
            height, width = light[0].shape[:2]
            root = folder_paths.get_output_directory()
            folder, name, counter, subfolder, _ = folder_paths.get_save_image_path(
                filename_prefix, root, width, height
            )
            saved = []
            for number, picture in enumerate(light, start=counter):
                file = f"{name}_{number:05}_.{format}"
                bits = {} if format == "exr" else {"bits": 16}
                write_image(Path(folder) / file, picture, **bits)
                saved.append({"filename": file, "subfolder": subfolder, "type": "output"})
            return {"ui": {"images": saved}}
