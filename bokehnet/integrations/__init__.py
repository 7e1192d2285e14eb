"""Interface for plug-ins of other programs: a loaded renderer behind a pipe. Open first: :mod:`.warm`.

In: requests of one JSON line each, with files or shared memory for the pixels. Out: progress, results and
errors of one JSON line each. The plug-ins are in the folder ``integrations`` of the repository.
"""
