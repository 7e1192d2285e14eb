"""Depth that phones store in photos: one file a maker, and the coding of grey values that they share."""
