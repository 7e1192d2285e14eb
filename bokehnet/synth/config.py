"""What a set of training pairs is made of."""

from dataclasses import dataclass, field

from bokehnet.checks import check_at_least
from bokehnet.errors import ParameterError

__all__ = ["SceneConfig", "SynthConfig"]


@dataclass(frozen=True, kw_only=True, slots=True)
class SceneConfig:
    """How random scenes are drawn.

    Attributes:
        planes: Fewest and most planes in front of the background, lights and ground not counted.
        tilt_limit: Largest tilt of a plane, degrees.
        sky_probability: Share of scenes whose background is infinitely far.
        ground_probability: Share with a floor, ceiling or wall that runs into the distance.
        light_probability: Share with small HDR lamps far away.
        thin_probability: Share of planes with thin forms: wires, hair, twigs.
        exposure_stops: Lowest and highest exposure relative to a middle grey of 0.18.
        photographs: Names of the photographs from scikit-image, without suffix; empty takes all of
            ``bokehnet.synth.photographs.SHIPPED``.
        photograph_folder: A folder of images to use instead of those photographs.
    """

    planes: tuple[int, int] = (2, 8)
    tilt_limit: float = 65.0
    sky_probability: float = 0.3
    ground_probability: float = 0.3
    light_probability: float = 0.2
    thin_probability: float = 0.3
    exposure_stops: tuple[float, float] = (-1.5, 1.0)
    photographs: tuple[str, ...] = ()
    photograph_folder: str | None = None

    def __post_init__(self) -> None:
        if not 0 <= self.planes[0] <= self.planes[1]:
            raise ParameterError(f"planes: expected two rising counts, got {self.planes}")
        if not 0 <= self.tilt_limit < 85:
            raise ParameterError(f"tilt_limit: expected 0 to 85 degrees, got {self.tilt_limit:g}")


@dataclass(frozen=True, kw_only=True, slots=True)
class SynthConfig:
    """A set of training pairs.

    Attributes:
        seed: Seed of the set; scene i depends on (seed, i) alone.
        scenes: Number of scenes.
        scenes_per_shard: Scenes in one file.
        width: Picture width, pixels.
        height: Picture height, pixels.
        views: Pictures with bokeh of each scene, each with its own focus and aperture.
        bokeh_samples: Rays per pixel of a bokeh picture.
        bright_factor: How many times more rays a scene with lamps gets: few rays meet them.
        image_samples: Rays per pixel of the all-in-focus picture.
        defocus: Range from which the largest blur radius of a view is drawn (log-uniform), pixels.
        sensor_width: Sensor width, mm.
        sensor_distance: Lens to sensor, mm, equal for all views so that refocusing does not zoom.
        nearest_distance: The depth at relative disparity 1, mm.
        scene: How scenes are drawn.
    """

    seed: int
    scenes: int
    scenes_per_shard: int = 50
    width: int = 256
    height: int = 256
    views: int = 3
    bokeh_samples: int = 64
    bright_factor: int = 3
    image_samples: int = 16
    defocus: tuple[float, float] = (3.0, 26.0)
    sensor_width: float = 36.0
    sensor_distance: float = 50.0
    nearest_distance: float = 1000.0
    scene: SceneConfig = field(default_factory=SceneConfig)

    def __post_init__(self) -> None:
        for name in (
            "scenes",
            "scenes_per_shard",
            "views",
            "bokeh_samples",
            "bright_factor",
            "image_samples",
        ):
            check_at_least(name, getattr(self, name), 1)
        for name in ("width", "height"):
            check_at_least(name, getattr(self, name), 8)
        check_at_least("seed", self.seed, 0)
        if not 0 < self.defocus[0] <= self.defocus[1]:
            raise ParameterError(f"defocus: expected two rising radii above 0, got {self.defocus}")

    @property
    def pixel_pitch(self) -> float:
        """Distance between the centres of two pixels, mm."""
        return self.sensor_width / self.width

    @property
    def shards(self) -> int:
        """Number of files."""
        return -(-self.scenes // self.scenes_per_shard)
