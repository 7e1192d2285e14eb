"""Node of the lens look: a preset, a traced lens, the aperture shape."""

from typing import Any, ClassVar

from bokehnet.lenses.catalog import catalog_names
from bokehnet.settings.fields import Setting
from bokehnet.settings.preset import load_preset, presets
from bokehnet.settings.settings import RenderSettings, all_settings, merged

from .host import CATEGORY, node_errors

_NONE = "none"

# Flags of the fields that have a widget; unit, range and help are those of the package.
_WIDGET_FLAGS = (
    "blades",
    "blade-curvature",
    "aperture-rotation",
    "squeeze",
    "cats-eye",
    "rim",
    "obstruction",
    "onion",
    "highlights",
    "highlight-gain",
)


def _widget_settings() -> dict[str, Setting]:
    return {item.flag: item for item in all_settings().values() if item.flag in _WIDGET_FLAGS}


def _widget(item: Setting) -> tuple[str | list[str], dict[str, Any]]:
    """Return the widget of a field; its initial value is the default of the field, or 0 without default."""
    if isinstance(item.default, str):  # clipped lights: estimated, or off
        return (["auto", "off"], {"default": item.default, "tooltip": item.help})
    is_integer = item.type is int
    low = item.low if item.low is not None else 0 if item.above is not None else -1e6
    high = item.high if item.high is not None else 1e6
    default = item.default if item.default is not None else 0
    options = {"default": default, "min": min(low, default), "max": high, "tooltip": item.help}
    return ("INT", options) if is_integer else ("FLOAT", {**options, "step": 0.01})


class BokehLook:
    """Combines a preset, a lens that overrides it, and widgets that override both."""

    CATEGORY: ClassVar[str] = CATEGORY
    FUNCTION: ClassVar[str] = "make"
    RETURN_TYPES: ClassVar[tuple[str, ...]] = ("BOKEH_LOOK",)
    RETURN_NAMES: ClassVar[tuple[str, ...]] = ("look",)

    @classmethod
    def INPUT_TYPES(cls) -> dict[str, Any]:  # noqa: N802  # ComfyUI's name
        """See ComfyUI."""
        known = _widget_settings()
        return {
            "required": {
                "preset": ([_NONE, *presets()],),
                "lens": ([_NONE, *catalog_names()],),
            },
            "optional": {flag.replace("-", "_"): _widget(known[flag]) for flag in _WIDGET_FLAGS}
            | {"below": ("BOKEH_LOOK",)},
        }

    def make(
        self, preset: str, lens: str, below: dict | None = None, **widgets: float | str
    ) -> tuple[dict[str, dict[str, Any]]]:
        """Return the changes of the look to the settings."""
        with node_errors():
            known = _widget_settings()
            overrides: dict[str, dict[str, Any]] = {} if lens == _NONE else {"lens": {"name": lens}}
            for name, value in widgets.items():
                item = known[name.replace("_", "-")]
                default = item.default if item.default is not None else 0
                if value != default:
                    overrides.setdefault(item.group, {})[item.name] = value
            look = {} if preset == _NONE else load_preset(preset).values
            changes = merged(below or {}, look, overrides)
            RenderSettings().updated(changes)
            return (changes,)
