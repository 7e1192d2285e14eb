"""A public benchmark of synthetic bokeh that needs no download; see ``README.md`` beside this file."""

# Changes whenever a scene, a truth or a score does: results of different numbers cannot be compared.
VERSION = 1
