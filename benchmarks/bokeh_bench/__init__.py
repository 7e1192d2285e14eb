"""Public benchmark of synthetic bokeh without downloads; see ``README.md`` in this folder."""

# Version of scenes, truths and scores: results of different versions are not comparable.
VERSION = 1
