"""Logs as text."""
