"""Which postures and squeezes to command, and what to expect of them (theory, section 7)."""

from tdfscal.planning.candidates import Candidates
from tdfscal.planning.choice import MOST, make_plan, plan_for_target
from tdfscal.planning.limits import Limits, travel_limits
from tdfscal.planning.plan import Objective, Plan, Request
from tdfscal.planning.predicted_information import Forecast

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
