"""The paper's studies on any rig: what wrong angles cost, and how well each method finds them."""
