"""Twenty right uses of the public names: a strict type checker accepts each of them."""

from pathlib import Path
from threading import Event

import numpy as np
import numpy.typing as npt

import bokehnet
from bokehnet import ApertureSettings, CameraSettings, FocusSettings, RenderOptions, RenderSettings

image: npt.NDArray[np.float32] = bokehnet.read_image("photo.jpg")  # 1
bokehnet.write_image(Path("out.png"), image, quality=90, bits=16)  # 2
settings = RenderSettings(camera=CameraSettings(blur=60), focus=FocusSettings(value=0.35))  # 3
look: RenderSettings = bokehnet.load_preset("petzval-swirl").over(settings)  # 4
names: list[str] = bokehnet.presets()  # 5
scene = bokehnet.read_scene("photo.jpg", source=bokehnet.RelativeDisparity(map="disparity.png"))  # 6
shot = bokehnet.make_scene(image, bokehnet.MetricDepth(map=image[..., 0], unit="m"))  # 7
renderer = bokehnet.BokehRenderer("rays", aperture=bokehnet.Aperture(blades=6, curvature=0.4))  # 8
result: bokehnet.RenderResult = renderer.render(scene, settings)  # 9
result.save("out.exr")  # 10
bokeh: npt.NDArray[np.float32] = renderer.render_arrays(image, image[..., 0]).bokeh  # 11
renderer.render_arrays(image, disparity=image[..., 0], blur=60, options=RenderOptions(gamma=1.0))  # 12
renderer.render(scene, settings, lambda done, total: None, cancel=Event())  # 13
blades: int = settings.updated({"aperture": {"blades": 9}}).aperture.blades  # 14
engine: str = result.report.engine  # 15
defocus: npt.NDArray[np.float32] = renderer.prepare(scene, settings).defocus  # 16
spread: npt.NDArray[np.float32] = bokehnet.scatter(image, defocus, bokehnet.Aperture(cats_eye=0.5))  # 17
bokehnet.save_settings("look.toml", RenderSettings(aperture=ApertureSettings(blades=5)))  # 18
lens: float = bokehnet.load_lens("double_gauss", f_number=2.8).focal_length  # 19
radius: npt.NDArray[np.float32] = bokehnet.defocus_from_disparity(image[..., 0], 60.0, 0.5)  # 20
