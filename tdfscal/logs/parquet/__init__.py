"""Logs in Parquet."""
