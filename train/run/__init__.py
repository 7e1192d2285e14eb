"""Runs of a training: command line, loop, log, folder, processes and early stop."""
