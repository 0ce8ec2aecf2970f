"""The calibration file `tdfscal-calibration/1`: its model, and how results become one."""
