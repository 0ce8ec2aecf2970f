"""Forward physics of the rig, independent of the measurement model.

A rigid terminal stands on elastic carriages, so that positioning errors and commanded squeezes
strain it as they do on a real machine; its forces are those of the static equilibrium.
"""

from tdfscal.simulation.campaign import Batch as Batch
from tdfscal.simulation.campaign import Campaign as Campaign
from tdfscal.simulation.campaign import simulate_campaign as simulate_campaign
from tdfscal.simulation.campaign import simulate_dwells as simulate_dwells
from tdfscal.simulation.equilibrium import Equilibrium as Equilibrium
from tdfscal.simulation.equilibrium import Load as Load
from tdfscal.simulation.equilibrium import Pose as Pose
from tdfscal.simulation.equilibrium import internal_part as internal_part
from tdfscal.simulation.equilibrium import settle as settle
from tdfscal.simulation.faults import Contact as Contact
from tdfscal.simulation.faults import Drift as Drift
from tdfscal.simulation.faults import Faults as Faults
from tdfscal.simulation.faults import Gain as Gain
from tdfscal.simulation.faults import Jolt as Jolt
from tdfscal.simulation.faults import Slip as Slip
from tdfscal.simulation.faults import ZeroShift as ZeroShift
from tdfscal.simulation.options import Options as Options
from tdfscal.simulation.options import Recorder as Recorder
from tdfscal.simulation.options import SurveyOptions as SurveyOptions
from tdfscal.simulation.scenarios import MOVING as MOVING
from tdfscal.simulation.scenarios import SCENARIOS as SCENARIOS
from tdfscal.simulation.scenarios import Run as Run
from tdfscal.simulation.scenarios import run as run
from tdfscal.simulation.truth import Survey as Survey
from tdfscal.simulation.truth import Truth as Truth
from tdfscal.simulation.truth import draw_truths as draw_truths
from tdfscal.simulation.truth import make_rig as make_rig
from tdfscal.simulation.truth import measure as measure
from tdfscal.simulation.truth import reference_rig as reference_rig
from tdfscal.simulation.truth import simulate_survey as simulate_survey
