"""`study …`: the paper's studies, on any rig."""

from tdfscal.workflows.study.accuracy import accuracy
from tdfscal.workflows.study.cost import cost
from tdfscal.workflows.study.docking import docking
from tdfscal.workflows.study.free_space import free_space
from tdfscal.workflows.study.paper import paper
from tdfscal.workflows.study.sensitivity import sensitivity
from tdfscal.workflows.study.success import success

__all__ = ["accuracy", "cost", "docking", "free_space", "paper", "sensitivity", "success"]
