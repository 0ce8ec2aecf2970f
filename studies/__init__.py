"""The studies of the paper's Sections 4 and 5, run from a checkout: `python -m studies`."""
