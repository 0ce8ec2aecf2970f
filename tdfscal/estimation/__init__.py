"""The engine: what is made of whitened rows, wherever they come from."""
