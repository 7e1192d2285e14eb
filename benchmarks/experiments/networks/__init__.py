"""Networks that were trained for one question."""
