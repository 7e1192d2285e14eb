"""Sequences of frames: numbered files, pulls of focus, videos, and maps filtered over time.

In: pictures and maps of many frames and the settings that change between them. Out: the settings of each
frame, the decisions made once for a shot, steady maps, written videos.

Open first: ``sequence.py``, ``shot.py``, ``video.py``; ``temporal_filter.py`` for the maps over time.
"""
