"""Jobs of the service: the folder that stores them, worker processes that render them, and their pool.

Open first: ``store.py``.
"""
