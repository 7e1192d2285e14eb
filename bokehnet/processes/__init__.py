"""Processes: locks after a fork, resource limits of workers, connection to a Ray cluster."""
