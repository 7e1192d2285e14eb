"""March of pupil rays through layers, eight rays at once.

Open first: ``ray_marching.py``.
"""
