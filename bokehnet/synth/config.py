"""What a set of training pairs is made of."""

import math
from dataclasses import dataclass, field
from typing import Literal

from bokehnet.checks import check_at_least, check_range
from bokehnet.errors import ParameterError
from bokehnet.synth.training_lenses import covered_slope

__all__ = ["ClutterConfig", "SceneConfig", "SynthConfig"]


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
            raise ParameterError("planes", "two rising counts", self.planes)
        if not 0 <= self.tilt_limit < 85:
            raise ParameterError("tilt_limit", "0 up to below 85 degrees", self.tilt_limit)


@dataclass(frozen=True, kw_only=True, slots=True)
class ClutterConfig:
    """How random scenes with objects on the ground are drawn; exposure and photographs are SceneConfig's.

    Attributes:
        places: How often a scene is a table, a room and open land, relative to each other.
        objects: Fewest and most objects on the ground.
        thin_probability: Share of objects with thin forms: poles, fences, twigs with leaves, grass, hair.
        foreground_probability: Share of scenes with something near that comes in over the border.
        lamp_probability: Share of scenes with small HDR lamps.
    """

    places: tuple[float, float, float] = (1.0, 1.0, 1.0)
    objects: tuple[int, int] = (4, 14)
    thin_probability: float = 0.35
    foreground_probability: float = 0.5
    lamp_probability: float = 0.2

    def __post_init__(self) -> None:
        for weight in self.places:
            check_at_least("places", weight, 0)
        if not sum(self.places):
            raise ParameterError("places", "at least one weight above 0", self.places, shown="none")
        if not 0 <= self.objects[0] <= self.objects[1]:
            raise ParameterError("objects", "two rising counts", self.objects)


@dataclass(frozen=True, kw_only=True, slots=True)
class SynthConfig:
    """A set of training pairs.

    Attributes:
        seed: Seed of the set; scene i depends on (seed, i) alone.
        kind: "planes" are cards at all depths that only shine; "clutter" are objects on the ground, with
            light, shades and shadows.
        scenes: Number of scenes.
        scenes_per_shard: Scenes in one file.
        width: Picture width, pixels.
        height: Picture height, pixels.
        views: Pictures with bokeh of each scene, each with its own focus and aperture.
        bokeh_samples: Rays per pixel of a bokeh picture.
        bright_factor: How many times more rays a scene with lamps gets: few rays meet them.
        image_samples: Rays per pixel of the all-in-focus picture, or per fine pixel where there are such.
        fine: Where not 0, the disparity is also written at so many times the size, an even number, so that
            what stands inside a pixel is known; such sets may have no views.
        defocus: Range from which the largest blur radius of a view is drawn (log-uniform), pixels.
        sensor_width: Sensor width, mm.
        sensor_distance: Lens to sensor, mm, equal for all views so that refocusing does not zoom.
        nearest_distance: The depth at relative disparity 1, mm.
        catalog: Lenses of the catalog to draw from, for clutter; each must cover the picture's corners.
        catalog_share: Share of views through one of them; the others are through thin lenses.
        scene: How scenes of planes are drawn.
        clutter: How scenes of clutter are drawn.
    """

    seed: int
    scenes: int
    kind: Literal["planes", "clutter"] = "planes"
    scenes_per_shard: int = 50
    width: int = 256
    height: int = 256
    views: int = 3
    bokeh_samples: int = 64
    bright_factor: int = 3
    image_samples: int = 16
    fine: int = 0
    defocus: tuple[float, float] = (3.0, 26.0)
    sensor_width: float = 36.0
    sensor_distance: float = 50.0
    nearest_distance: float = 1000.0
    catalog: tuple[str, ...] = ()
    catalog_share: float = 0.0
    scene: SceneConfig = field(default_factory=SceneConfig)
    clutter: ClutterConfig = field(default_factory=ClutterConfig)

    def __post_init__(self) -> None:
        for name in (
            "scenes",
            "scenes_per_shard",
            "bokeh_samples",
            "bright_factor",
            "image_samples",
        ):
            check_at_least(name, getattr(self, name), 1)
        for name in ("width", "height"):
            check_at_least(name, getattr(self, name), 8)
        check_at_least("seed", self.seed, 0)
        check_at_least("views", self.views, 0 if self.fine else 1)
        if self.fine < 0 or self.fine % 2:
            raise ParameterError("fine", "0 or an even number", self.fine)
        if not 0 < self.defocus[0] <= self.defocus[1]:
            raise ParameterError("defocus", "two rising radii above 0", self.defocus)
        self._check_catalog()

    def _check_catalog(self) -> None:
        """Raise ``ParameterError`` unless the lenses of the catalog can take these pictures."""
        check_range("catalog_share", self.catalog_share, 0, 1)
        if self.catalog_share and not self.catalog:
            expected = "0, as `catalog` names no lens"
            raise ParameterError("catalog_share", expected, self.catalog_share, "name some in `catalog`")
        if self.catalog and self.kind != "clutter":
            raise ParameterError("kind", "'clutter', which alone is seen through a `catalog`", self.kind)
        corner = math.hypot(self.width, self.height) / 2 * self.pixel_pitch / self.sensor_distance
        for name in self.catalog:
            if covered_slope(name) < corner:
                raise ParameterError(
                    "catalog",
                    f"lenses that show slopes up to {corner:.3f}, where the picture's corners are",
                    name,
                    "take another lens or a larger `sensor_distance`",
                    shown=f"{name}, which shows slopes up to {covered_slope(name):.3f}",
                )

    @property
    def pixel_pitch(self) -> float:
        """Distance between the centres of two pixels, mm."""
        return self.sensor_width / self.width

    @property
    def shards(self) -> int:
        """Number of files."""
        return -(-self.scenes // self.scenes_per_shard)
