"""Does a calibration still hold, and if not, why."""
