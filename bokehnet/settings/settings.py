"""All settings of a render, each with unit, range and default in one place.

:class:`RenderSettings` is a frozen tree of groups and fields, as in ``settings.aperture.blades``. The options
of the command line, the keys of presets and the tables of TOML files derive from it, and errors name a field
by this path. The fields are defined in ``scene_settings.py``, ``engine_settings.py``, ``look_settings.py``
and ``light_settings.py``.
"""

import dataclasses
import difflib
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from typing import Any

from bokehnet.engine_registry import RAY_ENGINES
from bokehnet.errors import ErrorCollector, ParameterError
from bokehnet.settings.engine_settings import DeviceName, EngineName, EngineSettings, OutputSettings
from bokehnet.settings.fields import Group, Setting, field_settings, from_plain, to_plain
from bokehnet.settings.light_settings import LightSettings
from bokehnet.settings.look_settings import (
    ApertureSettings,
    ColorSettings,
    EffectSettings,
    HighlightSettings,
    LensSettings,
)
from bokehnet.settings.scene_settings import CameraSettings, DepthSettings, FocusSettings, InputSettings

__all__ = [
    "ApertureSettings",
    "CameraSettings",
    "ColorSettings",
    "DepthSettings",
    "DeviceName",
    "EffectSettings",
    "EngineName",
    "EngineSettings",
    "FocusSettings",
    "HighlightSettings",
    "InputSettings",
    "LensSettings",
    "LightSettings",
    "OutputSettings",
    "RenderSettings",
    "all_settings",
    "check_engine",
    "group_types",
    "merged",
    "settings_by_flag",
]


@dataclass(frozen=True, kw_only=True, slots=True)
class RenderSettings:
    """All settings of a render, in groups.

    The constructor of a group checks its values. Settings compare by value.

    Attributes:
        input: Files with the depth and the edges of the picture.
        depth: Reading and repair of the depth map.
        focus: Focus.
        camera: Blur strength.
        aperture: Shape of the aperture.
        lens: Lens and aberrations.
        color: Chromatic aberration.
        highlights: Treatment of bright light before the blur.
        light: Diffraction, ghosts and glare.
        effects: Camera effects on the blurred picture.
        engine: Engine, networks, device and memory bound.
        output: File format of the result, and additional outputs.

    Raises:
        ParameterError: A value has the wrong type or is out of range, or fields contradict each other.

    Examples:
        >>> from bokehnet.settings.settings import ApertureSettings, CameraSettings, RenderSettings
        >>> settings = RenderSettings(camera=CameraSettings(blur=60), aperture=ApertureSettings(blades=6))
        >>> settings.updated({"focus": {"value": 0.35}}).focus.value
        0.35
    """

    input: InputSettings = field(default_factory=InputSettings)
    depth: DepthSettings = field(default_factory=DepthSettings)
    focus: FocusSettings = field(default_factory=FocusSettings)
    camera: CameraSettings = field(default_factory=CameraSettings)
    aperture: ApertureSettings = field(default_factory=ApertureSettings)
    lens: LensSettings = field(default_factory=LensSettings)
    color: ColorSettings = field(default_factory=ColorSettings)
    highlights: HighlightSettings = field(default_factory=HighlightSettings)
    light: LightSettings = field(default_factory=LightSettings)
    effects: EffectSettings = field(default_factory=EffectSettings)
    engine: EngineSettings = field(default_factory=EngineSettings)
    output: OutputSettings = field(default_factory=OutputSettings)

    def __post_init__(self) -> None:
        for name, kind in _GROUPS.items():
            if not isinstance(getattr(self, name), kind):
                raise ParameterError(name, expected=f"a {kind.__name__}", got=getattr(self, name))
        _check_across(self)

    def updated(self, changes: Mapping[str, Mapping[str, Any]]) -> "RenderSettings":
        """Return these settings with some fields replaced.

        Args:
            changes: Group name to field name to value, as returned by :meth:`to_table`.

        Raises:
            ParameterError: A name is unknown, or as for the class.
        """
        groups: dict[str, Any] = {}
        errors = ErrorCollector()
        for group, fields in changes.items():
            with errors.collect():
                groups[group] = self._updated_group(group, fields)
        errors.raise_all()
        return dataclasses.replace(self, **groups)

    def _updated_group(self, group: str, fields: Mapping[str, Any]) -> Group:
        """Return a group with some fields replaced; raise all its errors as one."""
        if group not in _GROUPS:
            raise ParameterError(group, expected=f"one of {', '.join(_GROUPS)}", got=group)
        if not isinstance(fields, Mapping):
            raise ParameterError(group, expected="fields and their values", got=fields)
        known, errors = field_settings(_GROUPS[group]), ErrorCollector()
        values = {}
        for name, value in fields.items():
            with errors.collect():
                if name not in known:
                    near = difflib.get_close_matches(name, known, n=1)
                    remedy = f"did you mean {near[0]}?" if near else ""
                    raise ParameterError(f"{group}.{name}", f"one of {', '.join(known)}", name, remedy)
                values[name] = from_plain(known[name], value)
        errors.raise_all()
        updated: Group = dataclasses.replace(getattr(self, group), **values)
        return updated

    def to_table(self) -> dict[str, dict[str, Any]]:
        """Return the fields that differ from the defaults, by group, as plain values for TOML."""
        table = {}
        for name, kind in _GROUPS.items():
            group = getattr(self, name)
            known = field_settings(kind)
            values = {key: getattr(group, key) for key in known if getattr(group, key) != known[key].default}
            if values:
                table[name] = {key: to_plain(value) for key, value in values.items()}
        return table


_GROUPS: dict[str, type[Group]] = {
    kind.GROUP: kind
    for kind in (
        InputSettings,
        DepthSettings,
        FocusSettings,
        CameraSettings,
        ApertureSettings,
        LensSettings,
        ColorSettings,
        HighlightSettings,
        LightSettings,
        EffectSettings,
        EngineSettings,
        OutputSettings,
    )
}


# Remedy for settings of a depth map without its file.
_OWN_DEPTH = " (the picture's own file if its depth is inside)"


def _check_across(settings: RenderSettings) -> None:
    """Raise ``ParameterError`` unless the groups are consistent."""
    source, depth = settings.input, settings.depth
    needs = dict.fromkeys(("invert", "value_range", "as_stored"), "disparity")
    needs |= dict.fromkeys(("unit", "kind", "near", "far"), "depth")
    known = field_settings(depth)
    errors = ErrorCollector()
    for name, needed in needs.items():
        value = getattr(depth, name)
        with errors.collect():
            if value != known[name].default and getattr(source, needed) is None:
                raise ParameterError(
                    f"depth.{name}",
                    expected=f"`input.{needed}` for it to act on",
                    got=value,
                    remedy=f"give that{_OWN_DEPTH if needed == 'depth' else ''}, or leave this out",
                    shown="it alone" if value is True else None,
                )
    for name in ("coding", "no_data", "holes"):
        with errors.collect():
            if getattr(depth, name) != known[name].default and not (source.disparity or source.depth):
                raise ParameterError(
                    f"depth.{name}",
                    expected="`input.disparity` or `input.depth` for it to act on",
                    got=getattr(depth, name),
                    remedy="give one of them, or leave this out",
                )
    with errors.collect():
        _check_planes(depth)
    with errors.collect():
        if settings.light.ghosts is not None and settings.lens.name is None:
            raise ParameterError(
                "light.ghosts",
                expected="`lens.name`, whose surfaces reflect",
                got=settings.light.ghosts,
                remedy="give that, or leave this out",
            )
    with errors.collect():
        check_engine(settings, settings.engine.name)
    errors.raise_all()


def _check_planes(depth: DepthSettings) -> None:
    """Raise ``ParameterError`` unless the planes of the stored values 0 and 1 are consistent."""
    near, far = depth.near, depth.far
    if (near is None) != (far is None):
        missing = "near" if near is None else "far"
        raise ParameterError(
            f"depth.{missing}", expected="both `depth.near` and `depth.far`, or neither", shown="one"
        )
    if near is None or far is None:
        if depth.kind == "zbuffer":
            raise ParameterError(
                "depth.kind", expected="`depth.near` and `depth.far` with zbuffer", shown="neither"
            )
        return
    if depth.unit is not None or depth.kind == "ray":
        raise ParameterError(
            "depth.kind" if depth.kind == "ray" else "depth.unit",
            expected="either this or `depth.near` and `depth.far`",
            shown="both",
            remedy="leave one out",
        )
    if near == far or (depth.kind == "planar" and math.isinf(max(near, far))):
        raise ParameterError(
            "depth.far",
            expected="a finite distance different from `depth.near`, or `depth.kind` zbuffer",
            got=far,
        )


def check_engine(settings: RenderSettings, engine: str | None) -> None:
    """Raise ``ParameterError`` if the look needs an engine that traces rays, or colour fringes.

    Args:
        settings: Settings with the look.
        engine: Name of the engine; None if it is not known yet.

    Examples:
        >>> tails = RenderSettings(lens=LensSettings(coma=2))  # percent
        >>> check_engine(tails, "rays")
        >>> check_engine(tails, "scatter")
        Traceback (most recent call last):
            ...
        bokehnet.errors.ParameterError: lens.coma: expected `engine.name` rays or hybrid, ...
    """
    lens, color = settings.lens, settings.color
    sliders = ("name", "spherical", "coma", "astigmatism", "field_curvature")
    needing_rays = [f"lens.{name}" for name in sliders if getattr(lens, name)]
    needing_rays += [f"color.{name}" for name in ("axial", "lateral") if getattr(color, name)]
    if needing_rays and engine is not None and engine not in RAY_ENGINES:
        raise ParameterError(
            needing_rays[0],
            expected=f"`engine.name` {' or '.join(RAY_ENGINES)}, which trace rays through a lens",
            got=engine,
        )
    has_fringes = color.axial or color.lateral or lens.name is not None
    for name, neutral in (("dispersion", "continuous"), ("equaliser", (1.0,))):
        if getattr(color, name) not in (None, neutral) and not has_fringes:
            raise ParameterError(
                f"color.{name}",
                expected="colour fringes from `color.axial`, `color.lateral` or `lens.name`",
                shown="none",
            )


def merged(*layers: Mapping[str, Mapping[str, Any]]) -> dict[str, dict[str, Any]]:
    """Merge changes; later layers override earlier ones.

    Of mutually exclusive fields (:attr:`Group.ONE_OF`), that of the last layer stays.

    Args:
        layers: Group name to field name to value, each.

    Examples:
        >>> merged({"focus": {"value": 0.2}, "camera": {"blur": 9}}, {"focus": {"at": (3, 4)}})
        {'focus': {'at': (3, 4)}, 'camera': {'blur': 9}}
    """
    merged_values: dict[str, dict[str, Any]] = {}
    for layer in layers:
        for group, values in layer.items():
            merged_group = merged_values.setdefault(group, {})
            exclusive = _GROUPS[group].ONE_OF if group in _GROUPS else ()
            if any(values.get(name) is not None for name in exclusive):
                merged_group = {name: value for name, value in merged_group.items() if name not in exclusive}
                merged_values[group] = merged_group
            merged_group.update(values)
    return merged_values


@cache
def all_settings() -> Mapping[str, Setting]:
    """Return the description of each field of :class:`RenderSettings` by its path, ``aperture.blades``.

    Examples:
        >>> known = all_settings()["camera.focal_length"]
        >>> known.unit, known.flag, known.expectation
        ('mm', 'focal-length', 'a number above 0 mm')
    """
    return {known.path: known for kind in _GROUPS.values() for known in field_settings(kind).values()}


@cache
def settings_by_flag() -> Mapping[str, Setting]:
    """Return the description of each field by flag, including flags of earlier versions.

    Examples:
        >>> settings_by_flag()["cats-eye"].path, settings_by_flag()["focus-distance"].path
        ('aperture.cats_eye', 'focus.distance')
    """
    by_flag = {}
    for known in all_settings().values():
        for flag in (known.flag, *known.aliases):
            if flag is not None:
                by_flag[flag] = known
    return by_flag


def group_types() -> list[type[Group]]:
    """Return the group classes in the order of a help text.

    Examples:
        >>> first, *_ = group_types()
        >>> first.GROUP, first.TITLE
        ('input', 'Depth sources')
    """
    return list(_GROUPS.values())
