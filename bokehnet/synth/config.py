"""Configuration of a set of training pairs."""

import math
from dataclasses import dataclass, field
from typing import Literal

from bokehnet.checks import check_at_least, check_range
from bokehnet.errors import ParameterError
from bokehnet.synth.training_lenses import covered_slope

__all__ = ["ClutterConfig", "SceneConfig", "SynthConfig"]


@dataclass(frozen=True, kw_only=True, slots=True)
class SceneConfig:
    """Distribution of random scenes of planes.

    Attributes:
        planes: Minimum and maximum number of planes in front of the background, without lights and ground.
        tilt_limit: Maximum tilt of a plane, degrees.
        sky_probability: Probability of a background at infinity.
        ground_probability: Probability of a floor, ceiling or wall that recedes into the distance.
        light_probability: Probability of small, distant HDR lamps.
        thin_probability: Probability of a thin shape for a plane: wires, hair, twigs.
        exposure_stops: Minimum and maximum exposure relative to a middle grey of 0.18, stops.
        photographs: Names of photographs from scikit-image, without suffix; empty selects all of
            ``bokehnet.synth.photographs.SHIPPED``.
        photograph_folder: Folder of images to use instead.
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
        if self.photographs and self.photograph_folder is not None:
            expected = "a folder or names of `photographs`, not both"
            raise ParameterError("photograph_folder", expected, self.photograph_folder)


@dataclass(frozen=True, kw_only=True, slots=True)
class ClutterConfig:
    """Distribution of random scenes with objects; ``SceneConfig`` sets exposure and photographs.

    Attributes:
        places: Relative frequencies of tables, rooms and open land.
        objects: Minimum and maximum number of objects on the ground.
        thin_probability: Probability of a thin object: poles, fences, twigs with leaves, grass, hair.
        foreground_probability: Probability of a near object that enters the picture from the border.
        lamp_probability: Probability of small HDR lamps.
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
    """Configuration of a set of training pairs.

    Attributes:
        seed: Seed of the set; scene i depends only on (seed, i).
        kind: "planes": emissive planes at all depths; "clutter": objects on the ground, with lighting,
            shading and shadows.
        scenes: Number of scenes.
        scenes_per_shard: Number of scenes per file.
        width: Picture width, pixels.
        height: Picture height, pixels.
        views: Pictures with bokeh per scene, each with its own focus and aperture.
        bokeh_samples: Rays per pixel of a bokeh picture.
        bright_factor: Factor on the rays per pixel for scenes with lamps, which few rays hit.
        image_samples: Rays per pixel of the all-in-focus picture, or per fine pixel if ``fine`` is set.
        fine: If not 0, an even factor: disparity is also written at this multiple of the resolution, so that
            the structure inside a pixel is known; such sets may have no views.
        defocus: Range of the maximum blur radius of a view (log-uniform), pixels.
        sensor_width: Sensor width, mm.
        sensor_distance: Distance from lens to sensor, mm; equal for all views, so that refocusing does not
            zoom.
        nearest_distance: Depth at relative disparity 1, mm.
        catalog: Catalog lenses to draw from, for clutter; each must cover the picture's corners.
        catalog_share: Fraction of views through a catalog lens; the others use thin lenses.
        scene: Distribution of scenes of planes.
        clutter: Distribution of scenes of clutter.
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
        """Raise ``ParameterError`` unless all catalog lenses cover the picture."""
        check_range("catalog_share", self.catalog_share, 0, 1)
        if self.catalog_share and not self.catalog:
            expected = "0, as `catalog` names no lens"
            raise ParameterError("catalog_share", expected, self.catalog_share, "name some in `catalog`")
        if self.catalog and self.kind != "clutter":
            raise ParameterError("kind", "'clutter', the only kind that supports a `catalog`", self.kind)
        corner = math.hypot(self.width, self.height) / 2 * self.pixel_pitch / self.sensor_distance
        for name in self.catalog:
            if covered_slope(name) < corner:
                raise ParameterError(
                    "catalog",
                    f"lenses that cover slopes up to {corner:.3f}, the picture's corners",
                    name,
                    "take another lens or a larger `sensor_distance`",
                    shown=f"{name}, which covers slopes up to {covered_slope(name):.3f}",
                )

    @property
    def pixel_pitch(self) -> float:
        """Distance between the centres of two pixels, mm."""
        return self.sensor_width / self.width

    @property
    def shards(self) -> int:
        """Number of files."""
        return -(-self.scenes // self.scenes_per_shard)
