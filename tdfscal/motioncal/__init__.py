"""Self-calibration in motion: from streams of samples to a judged result (theory, section 8)."""
