"""What programs of other makers talk to: a warm renderer behind a pipe. Open first: :mod:`.warm`.

In go requests of one JSON line each, with files or shared memory for the pixels; out come progress, results
and errors of one JSON line each. Their plug-ins stand in the folder ``integrations`` of the repository.
"""
