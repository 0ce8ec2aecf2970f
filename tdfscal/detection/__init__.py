"""Which contact a calibrated rig notices along a path, and which thresholds it may be given."""
