"""tdfscal: calibrates how three-axis force sensors are mounted."""

__version__ = "0.1.0"
