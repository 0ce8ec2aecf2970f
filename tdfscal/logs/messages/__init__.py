"""Recordings of messages by topic: which topics carry the signals, and how they are decoded."""
