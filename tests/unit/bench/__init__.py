"""Tests of the benchmark package in ``bench/``."""
