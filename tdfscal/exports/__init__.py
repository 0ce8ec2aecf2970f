"""A calibration in the formats of controllers and of calibration laboratories."""
