"""Complete renderer in one ONNX file; standard operators only. Needs onnx."""
