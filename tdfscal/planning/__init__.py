"""Which postures and squeezes to command, and what to expect of them (theory, section 7)."""
