"""Connections of the service: bounds, authentication, streamed uploads, the page ``/docs``."""
