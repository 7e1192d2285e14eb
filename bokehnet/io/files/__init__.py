"""Bytes and text of files: atomic writes, buffers, threads of the decoder, UTF-8."""
