"""Pictures of the documentation, one command a page."""
