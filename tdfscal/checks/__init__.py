"""Does a log fit its rig file or its calibration; which sensors are faulty."""
