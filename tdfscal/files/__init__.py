"""Everything that touches a disk."""

#: What the rig file of a campaign folder is called.
RIG_NAME = "rig.yaml"
