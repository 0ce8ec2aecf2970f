"""`study …`: the paper's studies, on any rig."""

from tdfscal.workflows.study.accuracy import accuracy
from tdfscal.workflows.study.assembly import docking, free_space, success
from tdfscal.workflows.study.cost import cost
from tdfscal.workflows.study.paper import paper
from tdfscal.workflows.study.sensitivity import sensitivity

__all__ = ["accuracy", "cost", "docking", "free_space", "paper", "sensitivity", "success"]
