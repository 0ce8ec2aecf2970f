"""Self-calibration: from postures to a judged result."""
