"""Recorders: each writes a log in one format, deterministically, to the last bit of a double."""
