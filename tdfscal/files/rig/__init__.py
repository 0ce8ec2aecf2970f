"""The rig file `tdfscal-rig/1`: its model, and how it is read."""
