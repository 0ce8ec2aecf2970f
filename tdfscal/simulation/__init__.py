"""Forward physics of the rig, independent of the measurement model."""
