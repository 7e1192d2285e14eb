"""Krita plug-in: the blur of a real lens, from a layer with the depth."""

from .extension import BokehnetExtension, render_document

__all__ = ["BokehnetExtension", "render_document"]

try:
    from krita import Krita
except ImportError:  # outside Krita, such as in a syntax check
    Krita = None
if Krita is not None and Krita.instance() is not None:
    Krita.instance().addExtension(BokehnetExtension(Krita.instance()))
