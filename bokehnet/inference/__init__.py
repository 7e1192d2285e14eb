"""Inference with trained networks in ONNX Runtime: sessions, depth networks and their downloads."""
