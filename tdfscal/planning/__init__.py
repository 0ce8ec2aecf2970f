"""Which postures and squeezes to command, and what to expect of them (theory, section 7)."""

from tdfscal.planning.candidates import Candidates
from tdfscal.planning.information import Forecast
from tdfscal.planning.limits import Limits, travel_limits
from tdfscal.planning.make import MOST, make_plan, plan_for_target
from tdfscal.planning.plan import Objective, Plan, Request

__all__ = [
    "MOST",
    "Candidates",
    "Forecast",
    "Limits",
    "Objective",
    "Plan",
    "Request",
    "make_plan",
    "plan_for_target",
    "travel_limits",
]
