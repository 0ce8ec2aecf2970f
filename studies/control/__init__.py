"""The impedance-controlled machine of the paper's Section 5, simulated."""
