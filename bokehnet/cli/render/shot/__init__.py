"""Frames of a shot: in one process, in several processes, or on a cluster.

Open first: ``workers.py``.
"""
