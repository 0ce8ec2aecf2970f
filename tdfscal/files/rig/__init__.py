"""The rig file `tdfscal-rig/1`: its model, and how it is read."""

#: What the rig file of a campaign folder is called.
RIG_NAME = "rig.yaml"
