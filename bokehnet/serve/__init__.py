"""Rendering as a service: HTTP jobs, rendered by worker processes, stored in a folder.

In: a picture, its depth, and settings in groups as in TOML files. Out: the picture that the command line
would write. The folder is the only state: an accepted job has exactly one outcome, even if processes die, and
several services may share the folder. Open first: ``store.py`` (jobs on disk), ``pool.py`` (workers),
``app.py`` (HTTP interface). POSIX only.
"""
