"""Installation rotations by laser tracker (Sect. 3.2) and registration of point files."""
