"""Videos: read frames as scene-linear light and write them, with PyAV (extra ``video``)."""
