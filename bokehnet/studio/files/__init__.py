"""Uploaded files, and the archive of a session."""
