"""Rendering as a service: jobs by HTTP, done by worker processes, kept in a folder.

In goes a picture, what tells its depth, and settings by groups as TOML files hold them; out comes the
picture that the command line would have written. The folder is the only truth: what was accepted there has
one outcome, whatever dies meanwhile, and several services may share it. Open first: ``store.py`` (what a job
is on the disk), ``pool.py`` (who renders it), ``app.py`` (what HTTP sees). POSIX only.
"""
