"""Everything that is written but a calibration: logs, campaigns, plans, contact wrenches."""
