"""Fixtures of the render tests, which the tests of a scene share."""

from tests.unit.render.conftest import folder, photo, steps

__all__ = ["folder", "photo", "steps"]
