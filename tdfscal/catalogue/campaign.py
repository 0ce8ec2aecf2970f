"""What is said of a self-calibration: of the gate, the campaign, its noise, its postures, and what
the residuals, or the distances between hinges, ask for that the rig file does not state.
"""

from __future__ import annotations

from tdfscal.catalogue.entry import Entry, entries

_SHIFT = (
    "({p}); uncorrected, this puts {angle} off by {harm}, {shift:.1f} times its standard "
    "uncertainty"
)
_SAID = "the residuals{campaign: of ~|} {tied:may as well mean|say} that %s "
_BESIDES = """
  ? zero , and the zero {zero} by {zero_shift:.1f} times its own
  ? held ; the uncertainty that is given allows for it
"""
SUSPECTS: dict[str, Entry] = (
    entries(
        """
zero-suspected warns
  {subject:the zero of ~{axis:, axis ~,|} is|the zeros of all sensors are} not what is stated
  -> tare again, or write `zero.std: {stated}` for {subject:~|every support} in rig.yaml (N)
sensitivity-suspected warns
  gain or crosstalk of {subject} is not what is stated
  -> have the sensor of {subject} checked, or write `uncertainty.force_sensitivity: {stated}` in
    rig.yaml (relative)
gain-suspected warns
  the gain of {subject} is not what is stated
  -> have the sensor of {subject} checked, or write `uncertainty.force_sensitivity: {stated}` in
    rig.yaml (relative)
mass-suspected warns
  the mass is not what is stated
  -> weigh again, or write `terminal.mass.std: {stated}` in rig.yaml (kg)
barycentre-suspected warns
  the barycentre is not where it is stated
  -> correct the barycentre (of the hinges' own LCS), or write `terminal.barycenter.std: {stated}`
    in rig.yaml (m)
hinge-suspected warns
  the hinge of {subject} is not where it is stated
  -> measure the hinges again, or write `uncertainty.hinge: {stated}` in rig.yaml (m)
datum-suspected warns
  the servo coordinates of {subject} are offset
  -> measure the servo datums, or write `uncertainty.datum: {stated}` in rig.yaml (m)
axis-scale-suspected warns
  the Z axis of the positioner of {subject} is out of scale by {size}
  -> measure its travel, and correct its scale, or the Z of its `position_scale` in rig.yaml
tilt-suspected warns
  gravity is not along -Z of the BCS
  -> level the BCS, or write `gravity.tilt_std: {stated}` in rig.yaml (rad)
terminal-pushed warns
  something pushes or turns the terminal alike in all postures, constant in the LCS, with up to
  {stated} N along an axis
  -> free the terminal of hoses, cables and springs, and record again
compliance-suspected warns
  the NCPs give between encoder and hinge
  -> see what is loose, or write `uncertainty.compliance: {{lateral: {stated}, vertical: {stated}}}`
    in rig.yaml (m/N)
hysteresis-suspected warns
  the hinges hold back against the turn by which a posture is reached
  -> see whether the hinges move freely, or write `uncertainty.hinge_moment: {stated}` in rig.yaml
    (N·m)
hinge-friction-suspected warns
  the moments scatter as friction of {stated} N·m in the hinges would make them
  -> see whether the hinges move freely, or write `uncertainty.hinge_moment: {stated}` in rig.yaml
    (N·m)
force-noise-suspected warns
  the forces scatter by {stated} N per axis and posture beyond what is stated
  -> see what shakes or hums, or write `uncertainty.force_noise: {stated}` in rig.yaml (N)
sensor-noise-suspected warns
  the forces of {subject} scatter by {stated} N per axis and posture beyond what is stated
  -> look at the sensor of {subject}, its cable and amplifier, or write `uncertainty.force_noise:
    {stated}` in rig.yaml (N)
positioner-noise-suspected warns
  the NCPs repeat {stated} m per axis worse than stated
  -> see what is loose, or write `uncertainty.positioner: {stated}` in rig.yaml (m)
zero-drift warns
  {subject:the zero of ~ drifts|the zeros of all sensors drift} over the campaign
  -> warm up and tare again, or write `drift.time: .inf` in rig.yaml
zero-temperature warns
  {subject:the zero of ~ follows|the zeros of all sensors follow} the temperature
  -> write `drift.temperature: .inf` in rig.yaml
zero-walk warns
  {subject:the zero of ~ wanders|the zeros of all sensors wander} at random
  -> let the sensors warm up, tare more often, or write `drift.walk: {stated}` in rig.yaml (N/√h)
zero-parabola warns
  {subject:the zero of ~ drifts|the zeros of all sensors drift} other than along a line
  -> record faster, or write `drift.walk: {stated}` in rig.yaml (N/√h)
sensor-slipped warns
  the sensor of {subject} turned by {change:rad} ± {change_95:rad} (95 %) about x, y, z of the
  BCS{posture: before posture ~|}{between:time}
  -> fasten the sensor of {subject}, look at its cable, let it settle, and record {campaign:~|the
    campaign} again{cut:; as it sits now, the part --from ~ calibrates it|}
zero-jumped warns
  the zero of {subject} jumped by {change:N} ± {change_95:N} (95 %) along x, y, z of the
  sensor{posture: before posture ~|}{between:time}
  -> look at the cable and amplifier of {subject}, let it settle, and record {campaign:~|the
    campaign} again{until:, or write `zero.std: unknown` for {subject} in rig.yaml, calibrate with
    --to ~ -o before.yaml,|}{cut: and update before.yaml by it with --from ~ -o after.yaml|}
contact-stays warns
  something pushed the terminal with {change:N} ± {change_95:N} (95 %) along x, y, z of the
  {frame}{posture: from posture ~|: it began or ended}{last: to ~|}{between:time}
  -> find what touched the terminal or was laid on it, free it, and record this part again; or all
    the rest, if that was touched: the readings cannot tell
rest-touched warns
  all that was kept was touched, with some {size} that stayed, and what was left out was free
  -> free the terminal, and record again; keep what was left out
""",
        f"{_SAID}{_SHIFT}",
        _BESIDES,
    )
    | entries(
        """
mounting-suspected warns
  the sensor of {subject} is not mounted as stated
  -> see how {subject} sits, and correct `nominal_rpy`, or write `rpy_std: {stated}` for {subject}
    in rig.yaml (rad)
""",
        f"{_SAID}({{p}})",
    )
    | entries(
        """
hinge-misplaced warns
  the hinge of {subject} is not where it is stated, by {size}{or_more: or more|}
  -> measure the hinges again, or write `uncertainty.hinge: {stated}` in rig.yaml
positions-offset warns
  the servo coordinates of {subject} are offset, by {size}{or_more: or more|}
  -> measure the servo datums{measured: and the hinges, which lie as these positions have them|}, or
    write `uncertainty.datum: {stated}` in rig.yaml
scale-differs warns
  positions and hinges differ in scale, by {number:.2%}
  -> check the scale of the hinges' survey, or of the positioners{lines:: ~|}
supports-give warns
  the NCPs give between encoder and hinge, by {size}
  -> see what is loose, or write `uncertainty.compliance: {{lateral: {stated}, vertical: {stated}}}`
    in rig.yaml
frame-turned warns
  the frame of the positioner of {subject} is turned by {amount:rad} about x, y, z
  -> align or calibrate the positioner of {subject}; hinge distances show no error that all
    positioners share
frame-scaled warns
  the {every:frames of all positioners are|frame of the positioner of {subject} is} scaled by
  {amount:1} along x, y, z
  -> calibrate the {every:positioners|positioner of {subject}}{lines:, or write
    ~|}{measured:, and measure the hinges anew, which lie as these positions have them: about
    {hinges}|}
frame-not-square warns
  the frame of the positioner of {subject} is not square, by {amount:rad} of yz, xz, xy
  -> align or calibrate the positioner of {subject}; hinge distances show no error that all
    positioners share
""",
        f"the distances between hinges {{tied:may as well mean|say}} that %s {_SHIFT}",
        f"{_BESIDES}  ? elsewhere ; other distances disagree too",
    )
)

CAMPAIGN: dict[str, Entry] = entries("""
angle-uncertain rejects
  {angle} of {subject} has a standard uncertainty of {size}, above the limit of {limit:rad}
linear-apart rejects
  the linear angles lie {number:.2g} times as far from the likeliest as their uncertainty explains
  -> use the default estimator
residuals-large rejects
  the residuals are {number:.2g} times what the stated uncertainties explain, above the limit of
  {limit:.2g}
postures-rejected rejects
  {number:.0f} of {postures} postures had to be rejected, above the limit of {limit:.0%}
contact-uncertain rejects
  the contact {subject} at roll, pitch, yaw = {rpy} rad has an expanded uncertainty of {size} (k =
  2, 95.45 %), above the limit of {limit:g}; its error exceeds the limit with a probability of
  {exceeding:p}
motion-left-out rejects
  {number:.0f} of {seconds:.0f} s had to be left out, above the limit of {limit:.0%}
moments-unlike-noise rejects
  the moments left over are no noise: positions would have to scatter by {size}, where {declared:m}
  is stated and the distances of the hinges show {shown:m}
  -> look for another inertia, hinges elsewhere, contact, cables; calibrate from dwells until then
methods-disagree rejects
  self-calibration and tracker differ beyond their uncertainties (joint {p}), in {above} of {of}
  angles by themselves (worst: {angle} of {support}: {difference:+.3g} mrad, E_n = {en:.2f})
  -> compare each method alone; what may lie between a sensor's body and its axes is
    `tracker.misalignment`
posture-over-capacity warns
  the {axis} axis of the sensor of {subject} reads {reading:.6g} N{time:time}; its capacity is
  {size}
posture-saturated warns
  the {axis} axis of the sensor of {subject} is saturated at {reading:.6g} N{time:time}
  -> squeeze less, carry less, or widen the range of sensor and amplifier
range-exceeded warns
  by the other readings the {axis} axis of the sensor of {subject} would read up to {size} where it
  is cut off, {excess:N} beyond its range
  -> {share:squeeze with at most ~ of these forces|lean or carry less, since the load alone exceeds
    it}, or widen the range of sensor and amplifier to {range:N} (or correct `capacity` of {subject}
    in rig.yaml)
posture-frozen warns
  the {axis} axis of the sensor of {subject} is frozen at {reading:.6g} N{time:time}
  ? since since {since:when}
  -> look at the sensor's cable and amplifier, leave the axis out of the sensor's `axes` in
    rig.yaml, or end before it with --to
posture-misfits warns
  unexplained force {size} and moment {moment:N·m} about the LCS origin, {ratio:.0f} times what is
  expected: contact, a hand, or a jolt
  -> find what touched the terminal, free it, and record again
stretch-frozen warns
  the {axis} {axes:axes|axis} of the sensor of {subject} {axes:are|is} frozen
  ? end : {begin:.2f} to {end:.2f} s of the log were left out
  -> look at the sensor's cable and amplifier, and record again; what is recorded calibrates
    {before:by the part before, with --to ~, or |}with `axes: [{others}]` for {subject} in rig.yaml,
    and none for its {axis} {axes:fields|field} in the log block
stretch-standing warns
  the position of {subject} is frozen while the terminal moves
  ? end : {begin:.2f} to {end:.2f} s of the log were left out
  -> look at the recorder's link to that positioner
stretch-over-capacity warns
  a sensor is at its capacity
  ? end : {begin:.2f} to {end:.2f} s of the log were left out
  -> squeeze less, or carry less
stretch-touched warns
  a wrench of {size} and {moment:N·m} about the barycentre that the model does not know: contact, or
  a motion too fast for it
  ? end : {begin:.2f} to {end:.2f} s of the log were left out
  -> find what touched the terminal in the stretches left out, and free it; where nothing did, move
    more slowly, or hold eight postures or more
draft-unconfirmed warns
  the result rests on {number:.0f} lines of the rig file to be confirmed: {subject}
  -> confirm these lines, and take the mark behind them out
fields-crossed warns
  by the names of their fields {subject} have the positions of one and the forces of another; where
  the hinges come from a log, no number tells which of the two is exchanged, and the other way round
  the angles are those of other sensors
  -> trace the cables of {subject}, and correct them, or the recorder's names
terminal-turned warns
  the terminal stands turned by {degrees:.0f}°{axis: about ~ of the BCS|} in {always:every
  posture|most postures}{upright:; all fits as well, upright, with positions and forces of ~|}
  -> check the supports' names in the log{upright:, or turn the LCS of rig.yaml, hinges and
    barycentre, upright|}
sensor-turned warns
  the sensor of {subject} is turned by {degrees:.0f}° from its nominal mounting
  -> look how {subject} sits: where it is turned, state its nominal_rpy in rig.yaml{lines:;
    where two of its axes have the opposite sign, write ~|}{mirrored:; where the log is left-handed,
    as no number tells, give Z of every position, hinge and the barycentre the opposite sign|}
angles-locked notes
  {subject} is pitched by {degrees:.0f}°, where roll and yaw are one turn: its uncertainties are
  those of the turns about X, Y and Z of the BCS
mounting-open warns
  {subject}: the axes that are measured leave the mounting of the sensor undetermined, so that it
  has no angles; the others stand
mounting-ambiguous warns
  another mounting explains the motion about as well, {other}; the nominal one decided
sensitivity-in-situ notes
  gain and crosstalk of the sensors were decoupled in situ, from a prior of {number:.2%}: a reading
  needs rotation · sensitivity⁻¹
noise-from-residuals warns
  neither the log nor rig.yaml states a force noise; it was taken from the residuals, so χ² cannot
  warn of contact or a wrong rig file
  -> state uncertainty.force_noise in rig.yaml
noise-understated warns
  the residuals are {number:.2g} times what the stated uncertainties explain ({p}); all noise was
  scaled up by that factor
noise-overstated warns
  the residuals are only {number:.2g} times what the stated uncertainties explain, which may be
  overstated
  -> state less noise or drift once a second campaign says so too
mass-exact warns
  the mass is stated as exact: an error of 0.1 % would move the zero {zero} by {moved:N}
  ({shift:.2g} times its standard uncertainty) and hardly show in a residual
  -> write its own as `terminal.mass.std`, or tare
barycentre-exact warns
  the barycentre is stated as exact: an error of 1 mm would move the zero {zero} by {moved:N}
  ({shift:.2g} times its standard uncertainty) and hardly show in a residual
  -> write its own as `terminal.barycenter.std`, or tare
parabola-estimated notes
  the residuals ask for more than a slope of the zeros in time: a parabola was estimated beside it
trials-unsettled warns
  {number:.0f} of {trials} Monte Carlo trials did not settle; they count where they ended: the
  angles are known so poorly that noise can turn a sensor away
intervals-by-trials notes
  Monte Carlo does not confirm the linear 95 % intervals; the intervals given are those of the
  trials
trials-left-out notes
  the linear intervals of {number:.0f} sensors stand without a Monte Carlo, which takes minutes
  -> ask for it by --trials
recording-paused warns
  no stream has a sample from {begin:.2f} to {end:.2f} s: the recording paused; the motion is cut
  there
clock-jumped warns
  no stream has a sample from {begin:.2f} to {end:.2f} s: the NCPs go on from where they stood: the
  clock of all streams jumped ahead; the motion is cut there
holes-more warns
  {number:.0f} more holes in all streams, cut likewise
dwells-few notes
  {number:.0f} static dwells are too few, {enough:.0f} are the least: the motion between them was
  used
  -> hold {enough:.0f} postures or more, each for 3 s ({number:.0f} are too few)
postures-few warns
  {number:.0f} {several:postures are|posture is} too few, {enough:.0f} are the least: they hardly
  show what touched the terminal or is stated wrongly
  -> record {enough:.0f} postures or more, tilted and squeezed
dwells-unjudged notes
  {number:.0f} static {several:dwells do|dwell does} not suffice to be judged alone: what touched
  the terminal there only the other campaigns can tell
moves-add-nothing notes
  the moves add nothing to the dwells: {why}
stops-left-out warns
  {number:.0f} of {stops} stops were left out (mostly: {reason})
  -> hold postures for longer, and see that forces and positions share one clock
stops-over-capacity warns
  {number:.0f} of {stops} stops were left out (mostly: {reason}), and F{axis} of {subject} reaches
  its capacity of {capacity:N}
  -> squeeze less, or widen the range of sensor and amplifier
""")
