"""``bokehnet render``: the command, its frames, workers and summary lines.

Open first: ``command.py``.
"""
