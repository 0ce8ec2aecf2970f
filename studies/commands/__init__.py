"""`study …`: the paper's studies, on any rig."""

from studies.commands.accuracy import accuracy
from studies.commands.assembly import docking, free_space, success
from studies.commands.cost import cost
from studies.commands.paper import paper
from studies.commands.sensitivity import sensitivity

__all__ = ["accuracy", "cost", "docking", "free_space", "paper", "sensitivity", "success"]
