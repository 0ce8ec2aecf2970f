"""Everything that touches a disk."""

#: What the rig file of a campaign folder is called.
RIG_NAME = "rig.yaml"
#: Names the writer in the first record of a recording of contact wrenches.
WRENCH_WRITER = "tdfscal contact wrench"
