"""Twenty wrong uses of the public names: a strict type checker refuses each of them."""

import numpy as np
import numpy.typing as npt

import bokehnet
from bokehnet import CameraSettings, FocusSettings, RenderSettings

image: npt.NDArray[np.float32] = bokehnet.read_image("photo.jpg")
scene = bokehnet.demo_scene()
renderer = bokehnet.BokehRenderer()

bokehnet.read_image(5)  # 1
bokehnet.write_image("out.png", "picture")  # 2
bokehnet.write_image("out.png", image, bits=12)  # 3
CameraSettings(blur="60")  # 4
CameraSettings(60)  # 5
FocusSettings(at=(1.5, 2.5))  # 6
RenderSettings(camera=FocusSettings())  # 7
RenderSettings(blur=60)  # 8
bokehnet.DepthSettings(repair="maybe")  # 9
bokehnet.EngineSettings(name="magic")  # 10
bokehnet.BokehRenderer("magic")  # 11
bokehnet.BokehRenderer("rays", aperture="round")  # 12
renderer.render(scene, 60)  # 13
renderer.render_arrays(image, defocus="blur")  # 14
renderer.render(scene, RenderSettings(), cancel=True)  # 15
bokehnet.make_scene(image, image)  # 16
bokehnet.RelativeDisparity(image)  # 17
blades: str = RenderSettings().aperture.blades  # 18
bokehnet.scatter(image, "defocus")  # 19
name = bokehnet.no_such_name  # 20
