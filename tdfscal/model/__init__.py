"""The measurement model, once."""
