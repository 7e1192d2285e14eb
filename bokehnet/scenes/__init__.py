"""Scene files for the ray tracer, and the files that it writes."""

from bokehnet.checks import require_extra

require_extra("torch", "trace")

from bokehnet.scenes.film import load_film, save_film
from bokehnet.scenes.reader import SceneJob, read_scene

__all__ = ["SceneJob", "load_film", "read_scene", "save_film"]
