"""Settings after the choice of another picture, depth or preset, and the offer to estimate depth."""

from collections.abc import Mapping
from typing import Any

from bokehnet.errors import BokehnetError, ConfigError
from bokehnet.inference.depth_models import recommended_model
from bokehnet.inference.model_download import cached_file, download_offer
from bokehnet.settings.preset import load_preset
from bokehnet.settings.settings import InputSettings, RenderSettings, all_settings, merged

__all__ = ["depth_offer", "settings_of_new_picture", "settings_with_depth", "settings_with_preset"]


def settings_of_new_picture(inputs: Mapping[str, Any], preset: str) -> RenderSettings:
    """Return the settings of a new picture: its depth, and the look of a preset; empty for none."""
    look = load_preset(preset).values if preset else {}
    return RenderSettings().updated(merged(look, {InputSettings.GROUP: dict(inputs)} if inputs else {}))


def settings_with_depth(settings: RenderSettings, inputs: Mapping[str, Any]) -> RenderSettings:
    """Return settings with another depth, and without what belongs to the present one; the look stays."""
    kept = {
        group: fields
        for group, fields in settings.to_table().items()
        if group not in (InputSettings.GROUP, "depth", "focus", "camera")
    }
    look = _fields(settings, of_look=True)
    kept |= {group: look[group] for group in ("focus", "camera") if group in look}
    return RenderSettings().updated({**kept, InputSettings.GROUP: dict(inputs)})


def _fields(settings: RenderSettings, *, of_look: bool) -> dict[str, dict[str, Any]]:
    """Return the fields by group that presets may set, or all others."""
    return {
        group: {
            key: value
            for key, value in fields.items()
            if all_settings()[f"{group}.{key}"].allowed_in_preset == of_look
        }
        for group, fields in settings.to_table().items()
    }


def settings_with_preset(settings: RenderSettings, preset: str) -> RenderSettings:
    """Return settings with the look of a shipped preset; an empty name removes the look.

    Raises:
        ConfigError: There is no such preset, or its name is that of a file.
    """
    without_look = _fields(settings, of_look=False)
    if preset == "":
        return RenderSettings().updated(without_look)
    if "/" in preset or "\\" in preset or preset.endswith(".toml"):
        raise ConfigError("expected the name of a preset, found a file name")
    return RenderSettings().updated(merged(without_look, load_preset(preset).values))


def depth_offer() -> dict[str, Any]:
    """Return the depth network for a picture without depth, and what a user must know of it."""
    model = recommended_model()
    if model is None:
        return {"available": False, "reason": "this version names no depth network"}
    try:
        is_cached = cached_file(model) is not None
        offer = download_offer(model)
    except BokehnetError as error:
        return {"available": False, "reason": " ".join(str(error).split())}
    return {
        "available": True,
        "cached": is_cached,
        "name": offer.name,
        "size": offer.size,
        "licence": offer.licence,
        "text": offer.text,
    }
