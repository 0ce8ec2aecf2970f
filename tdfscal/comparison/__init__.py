"""Two or more calibrations of one rig: compatibility, and both methods together."""
