"""Numpy and scipy only: arrays in, arrays out."""
