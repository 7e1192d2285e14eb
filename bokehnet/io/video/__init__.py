"""Videos: frames to scene-linear light and back, by PyAV (extra ``video``)."""
