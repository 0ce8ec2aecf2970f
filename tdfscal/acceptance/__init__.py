"""May this result steer a machine: the gate, and conformity of the contact wrench."""
