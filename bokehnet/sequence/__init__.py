"""Sequences of frames: numbered files, focus pulls, videos, and temporal filtering of maps.

In: pictures and maps of many frames and the settings that change between them. Out: the settings of each
frame, the decisions for an entire shot, temporally filtered maps, written videos.

Open first: ``sequence.py``, ``shot.py``, ``video.py``; ``temporal_filter.py`` for the maps over time.
"""
