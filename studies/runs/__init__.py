"""What the studies simulate, and the records that they make of it."""
