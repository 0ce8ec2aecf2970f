"""Logs in MCAP."""
