"""`study …`: the paper's studies, on any rig."""

from tdfscal.workflows.study.accuracy import accuracy
from tdfscal.workflows.study.docking import docking
from tdfscal.workflows.study.free_space import free_space
from tdfscal.workflows.study.sensitivity import sensitivity

__all__ = ["accuracy", "docking", "free_space", "sensitivity"]
