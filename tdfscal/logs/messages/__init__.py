"""Logs as messages by topic."""
