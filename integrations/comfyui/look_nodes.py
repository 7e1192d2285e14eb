"""The look of a lens: a preset, glass that is traced, the shape of the opening."""

from typing import Any, ClassVar

from bokehnet.lenses.catalog import catalog_names
from bokehnet.settings.fields import Setting
from bokehnet.settings.preset import load_preset, presets
from bokehnet.settings.settings import RenderSettings, all_settings, merged

from .host import CATEGORY, told

_NONE = "none"

# Fields that the node has a widget for, by their flags; unit, range and help are those of the package.
_FIELDS = (
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


def _known() -> dict[str, Setting]:
    return {item.flag: item for item in all_settings().values() if item.flag in _FIELDS}


def _widget(item: Setting) -> tuple[str, dict[str, Any]]:
    """Widget of a field: as nothing was said, it is at the field's default, or at its least."""
    whole = item.type is int
    low = item.low if item.low is not None else 0 if item.above is not None else -1e6
    high = item.high if item.high is not None else 1e6
    default = item.default if item.default is not None else 0
    shown = {"default": default, "min": min(low, default), "max": high, "tooltip": item.help}
    return ("INT", shown) if whole else ("FLOAT", {**shown, "step": 0.01})


class BokehLook:
    """A preset, over it a lens, over it what its widgets say."""

    CATEGORY: ClassVar[str] = CATEGORY
    FUNCTION: ClassVar[str] = "make"
    RETURN_TYPES: ClassVar[tuple[str, ...]] = ("BOKEH_LOOK",)
    RETURN_NAMES: ClassVar[tuple[str, ...]] = ("look",)

    @classmethod
    def INPUT_TYPES(cls) -> dict[str, Any]:  # noqa: N802  # ComfyUI's name
        """See ComfyUI."""
        known = _known()
        return {
            "required": {
                "preset": ([_NONE, *presets()],),
                "lens": ([_NONE, *catalog_names()],),
            },
            "optional": {flag.replace("-", "_"): _widget(known[flag]) for flag in _FIELDS}
            | {"below": ("BOKEH_LOOK",)},
        }

    def make(
        self, preset: str, lens: str, below: dict | None = None, **widgets: float
    ) -> tuple[dict[str, dict[str, Any]]]:
        """Return the changes that the look makes to the settings."""
        with told():
            known = _known()
            said: dict[str, dict[str, Any]] = {} if lens == _NONE else {"lens": {"name": lens}}
            for name, value in widgets.items():
                item = known[name.replace("_", "-")]
                plain = item.default if item.default is not None else 0
                if value != plain:
                    said.setdefault(item.group, {})[item.name] = value
            look = {} if preset == _NONE else load_preset(preset).values
            changes = merged(below or {}, look, said)
            RenderSettings().updated(changes)
            return (changes,)
