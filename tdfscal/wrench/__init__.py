"""The contact wrench of a log, by a calibration."""
