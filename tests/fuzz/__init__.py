"""Fuzzing of every reader: ``python -m tests.fuzz --minutes N``.

Each attempt runs in a forked child under resource limits. It may succeed, or fail with one line of the
program's own and exit code 1. Everything else is a finding: a traceback, a line of a decoder, several lines,
a crash, a run beyond the time limit, memory beyond the bound, a wrong exit code.
"""
