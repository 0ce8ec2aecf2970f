"""Forward physics of the rig, independent of the measurement model.

A rigid terminal stands on elastic carriages, so that positioning errors and commanded squeezes
strain it as they do on a real machine; its forces are those of the static equilibrium.
"""

from tdfscal.simulation.campaign import Campaign, simulate_campaign
from tdfscal.simulation.equilibrium import Equilibrium, Load, Pose, settle
from tdfscal.simulation.faults import (
    Contact,
    Crosstalk,
    DeadAxis,
    Drift,
    Faults,
    Gain,
    Jolt,
    Slip,
    ZeroShift,
)
from tdfscal.simulation.moving_campaign import MovingCampaign
from tdfscal.simulation.options import Options, Recorder, SurveyOptions
from tdfscal.simulation.posture_means import Batch, simulate_dwells
from tdfscal.simulation.postures import internal_part
from tdfscal.simulation.reference_rig import make_rig, reference_rig
from tdfscal.simulation.scenarios import MOVING, SCENARIOS, Run, run, run_moving
from tdfscal.simulation.survey import Survey, measure, simulate_survey
from tdfscal.simulation.truth import Truth, draw_truths

__all__ = [
    "MOVING",
    "SCENARIOS",
    "Batch",
    "Campaign",
    "Contact",
    "Crosstalk",
    "DeadAxis",
    "Drift",
    "Equilibrium",
    "Faults",
    "Gain",
    "Jolt",
    "Load",
    "MovingCampaign",
    "Options",
    "Pose",
    "Recorder",
    "Run",
    "Slip",
    "Survey",
    "SurveyOptions",
    "Truth",
    "ZeroShift",
    "draw_truths",
    "internal_part",
    "make_rig",
    "measure",
    "reference_rig",
    "run",
    "run_moving",
    "settle",
    "simulate_campaign",
    "simulate_dwells",
    "simulate_survey",
]
