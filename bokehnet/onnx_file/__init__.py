"""One ONNX file with a whole renderer inside; standard operators only. Needs onnx."""
