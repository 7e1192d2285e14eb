"""Krita plug-in: the blur of a real lens, from a layer with the depth."""

from .extension import BokehnetExtension, render_document

__all__ = ["BokehnetExtension", "render_document"]

try:
    from krita import Krita
except ImportError:  # outside Krita, as in a check of this file
    Krita = None
if Krita is not None and Krita.instance() is not None:
    Krita.instance().addExtension(BokehnetExtension(Krita.instance()))
