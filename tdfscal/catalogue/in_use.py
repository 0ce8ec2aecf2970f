"""What is said where a calibration is used, checked, updated or pooled."""

from __future__ import annotations

from tdfscal.catalogue.entry import Entry, entries
from tdfscal.frozen import replace

#: What may have changed since a calibration.
_CHANGED = entries(
    """
change-sensor-turned rejects
  the sensor of {subject} has turned by {size} ± {spread}: {change:rad} about x, y, z of the BCS, ±
  {change_95:rad} (95 %)
  -> look at the mounting of this sensor, then calibrate again
change-sensors-turned rejects
  several sensors have turned, each by itself, or this is the calibration of another rig: {whose} by
  {change:rad}, ± {change_95:rad} (95 %)
  -> look whether it is, and at the mounting of every sensor, then calibrate again
change-zero-drifted rejects
  the zero of {subject} {stated:is off what the rig file states|has drifted} by {change:N} along
  {axes} of the sensor, ± {change_95:N} (95 %)
  -> tare, and validate again; if it returns, calibrate again
change-gain rejects
  the gain of {subject} has changed by {change:+} ± {change_95:-} % (95 %) along {axes} of the
  sensor{alike:, all alike|}{crosstalk:, with crosstalk|}
  -> have this sensor, its amplifier and its cable checked; calibrate with
    uncertainty.force_sensitivity until then
change-gains rejects
  the gains of all sensors have changed alike by {change:+} ± {change_95:-} % (95 %)
  -> weigh the terminal, or look at what the amplifiers have in common, then calibrate again
change-load rejects
  the terminal's mass has changed by {mass:+} ± {mass_95:-} kg (95 %)
  ? shifted , and its barycentre by {barycentre:m}, ± {barycentre_95:m}
  -> correct the load, or the rig file and calibrate again
change-base-tilted rejects
  the base is no longer level as it was: {change:rad} about x, y of the BCS, ± {change_95:rad} (95
  %)
  -> level the base, or calibrate again with gravity.tilt_std declared
change-contact rejects
  contact in {more:postures|posture} {postures}: {size}, {torque:N·m} about the LCS origin
  -> free these postures and record them again before anything else
change-hinges-stick rejects
  the moments scatter as friction of {size} in the hinges makes them
  -> see whether the hinges move freely, or state uncertainty.hinge_moment
change-noise-grown rejects
  the forces of {whose} scatter by {size} per axis and posture more than log and rig file state
  -> look for what shakes or hums, at cables and amplifiers, or state uncertainty.force_noise, and
    validate again
change-sensor-slipped rejects
  the sensor of {subject} turned by {change:rad} about x, y, z of the BCS, ± {change_95:rad} (95
  %){posture:, before posture ~|}{between:time}
  -> fasten this sensor, look at its cable, then calibrate again
change-zero-jumped rejects
  the zero of {subject} jumped by {change:N} along x, y, z of the sensor, ± {change_95:N} (95
  %){last:, from posture {posture} to ~|{posture:, before posture ~|}}{between:time}
  ? last ; a steady pull at that hinge looks alike
  -> look at the sensor, its cable and amplifier, tare, and validate again
change-zeros-drift rejects
  the zeros of {whose} drift over the log, by up to {size}
  -> let sensors and amplifiers warm up, or state drift.time
change-zeros-follow-temperature rejects
  the zeros of {whose} follow the temperature, by up to {size} over the log
  -> let sensors and amplifiers warm up, or state drift.temperature
change-zeros-moved rejects
  the zeros of all sensors have moved by about {size} per axis, farther than the rig file's zero.std
  has it
  -> tare, or state in zero.std by how much zeros move, and validate again
change-zeros-wander rejects
  the zeros of all sensors wander by {size} per axis, from posture to posture and over the whole log
  -> let sensors and amplifiers warm up, or state drift.walk, and validate again
""",
    "{tied:or |}%s",
)
#: Of causes that a log does not tell apart each one's cure holds for that one alone.
_CHANGES = {
    code: replace(one, cure="{rivals:if it is this, |}" + one.cure)
    for code, one in _CHANGED.items()
}

IN_USE: dict[str, Entry] = {
    **entries("""
campaigns-changed rejects
  {said}
  -> calibrate {parts:each part|what came after it} by itself: {apart}{creeps:; or declare
    drift.angle, where this pace is the rig's own|}
"""),
    **_CHANGES,
    **entries("""
rejected-in-use warns
  {subject} IS A REJECTED CALIBRATION, not fit for use: {why}
provisional-in-use warns
  {subject} is provisional: {number:.0f} line{several:s|} of its rig file {several:are|is} still to
  be confirmed, {several:first|namely} {lines}; its `findings` name each
  -> confirm them and calibrate again
rig-renamed warns
  {subject} is of {own}, {than} of {other}
serials-untold warns
  {subject} states the serial of {whose}, {than} does not: whether it is the same one is not known
  -> state it in both
calibration-unsealed warns
  {subject} has no `content_sha256`: it was edited since it was written, or another program wrote
  it, and it is taken on trust but where its rotations, zeros, gains, load and covariances
  contradict each other
calibrations-compatible notes
  metrologically compatible: {first} and {second} agree within their uncertainties ({p}; largest
  difference: {angle} of {support}, {difference:+.3g} mrad, E_n = {en:.2f})
  ? above ; {above} of {of} angles alone {single:exceeds|exceed} E_n = 1, where chance makes
    {by_chance:.2g} on average
calibrations-incompatible rejects
  not compatible: the angles of {support} differ between {first} and {second} by more than the
  uncertainties of both ({p}), most in {angle}: {difference} mrad, E_n = {en:.2f}
calibrations-incompatible-together rejects
  not compatible: all angles together differ between {first} and {second} by more than the
  uncertainties of both ({p}), though no sensor does so by itself (largest: {angle} of {support},
  {difference:+.3g} mrad, E_n = {en:.2f})
compared-rejected rejects
  not verified: {names} was rejected by the quality gate
  -> mend what the gate names, calibrate again, and compare that
compared-same-data rejects
  {first} and {second} stand on the same recordings: they are no two results, and that they agree
  says nothing
  -> compare with a calibration from other recordings
compared-overlapping rejects
  {first} and {second} have recordings in common, and each has some of its own: they are no two
  results, and how far they may differ is not known
  -> compare calibrations that share no recording
compared-nothing-added rejects
  {whole} stands on the recordings of {part}, and what it has besides adds next to nothing to any
  angle: they are no two results
  -> compare with a calibration from other recordings
compared-nested notes
  {whole} stands on all recordings of {part} and on more: U is of what the others changed (the
  difference of both covariances){walked:, drift.angle included|}
  ? undated , over a time that a file's date tells
compared-stated-otherwise notes
  {subject} rest on other stated values of {whats}, from which a part of a difference may come
compared-other-rig rejects
  not of one rig: of that of {subject}, {differences}
  -> leave it out; or, where its rig file was only corrected, calibrate that campaign again by it
calibration-open warns
  the calibration leaves zeros, mass or barycentre open: the uncertainty of the components that they
  touch is unknown (empty)
posture-used-before warns
  it is of {subject}, which went into this calibration
log-used-before warns
  {subject} went into this calibration: what it shows is no proof
log-before-calibration warns
  this log is of {log}, and the calibration's data begin at {calibration}: what it says is about the
  time before it
noise-of-calibration notes
  neither the log nor the rig file states a force noise; {size} per axis and posture was taken from
  the residuals of the calibration
noise-as-calibrated notes
  noise is taken as {number:.2f} times what is stated, as the calibration's residuals showed it
  (fit.birge)
zeros-moved notes
  the readings fit zeros that have moved since the calibration, as by a tare, or a sensor's turn too
  small to be sure of
  ? axis ; the zero of {subject} along {axis} most clearly, by {size} ± {spread} (95 %)
  ? unclear ; no single zero's move is clear by itself (± {unclear:N}, 95 %)
  -> if they were tared, bring the new ones in by `tdfscal update`
zeros-beside-change notes
  together with that change the zeros come out other than the calibration's, most clearly that of
  {subject} along {axis}, by {size} ± {spread} (95 %)
change-unexplained rejects
  the residual wrench is not what the stated uncertainties explain, and no single cause explains it
  ({p})
  -> calibrate again
samples-uncovered notes
  {number:.0f} force samples lie where another stream has a gap, has not begun or has ended; they
  are left out
samples-unreadable notes
  {number:.0f} samples hold no number and are left out
wrench-in-part notes
  axes that no sensor measures leave {subject} of the contact wrench unknown: no uncertainty stands
  there (empty)
wrench-rewired warns
  the median wrench over the log is {size} and {torque:N·m}, and {ratio:.2g} times smaller with
  {other:~|log.force_on set to the other value}
  -> check the log block in rig.yaml, and the cabling
reading-absurd warns
  {subject} reads {size} on {axis} at {time:.2f} s, {capacity:beyond its capacity of ~ N|which is a
  hundred times the weight and more}: no contact does that, and the wrench there is none
  -> look at the sensor and its cable; leave it out with --from, --to
wrench-at-stops warns
  {stops:at most of its ~ stops|at its only stop} the wrench is larger than the stated uncertainty
  explains, in {subject}: in {axis} {size}, where {expected:.2g} is stated of a stop's mean (rms)
  ? bare ; without any calibration it is {bare:.3g}: this may be the calibration of another rig
  -> if nothing touched there, do not use these wrenches: `tdfscal validate` on this log says what
    has changed, zeros included
wrench-large warns
  the median wrench over the log is {size} and {torque:N·m}, {ratio:.2g} times the weight in force
  -> unless that is contact, check log.force_unit, log.force_on, the force fields and the cabling
postures-left-out warns
  {number:.0f} of {postures} postures were left out (mostly: {reason})
alarm-load rejects
  the load has changed {since}: mass or barycentre is not what it was ({check}; {p})
  -> weigh the terminal, and state its mass and barycentre in rig.yaml from that date on
alarm-together rejects
  on {raised} all sensors together depart from what they were, and no turn of a single one explains
  it ({check}; {p})
  -> look for what was loosened or knocked, then calibrate anew and go on from there, without the
    older files
alarm-step rejects
  {subject} has turned by {size} ± {spread} (95 %) {since}, by {change:rad}, ± {change_95:rad},
  about the BCS axes{late:; seen on ~|} ({check}; {p})
  -> look for what was loosened or knocked, then calibrate anew and go on from there, without the
    older files
alarm-creep rejects
  {subject} creeps by {size} ± {spread} a month (95 %) since about {onset}, by {change:rad}, ±
  {change_95:rad}, about the BCS axes{late:; seen on ~|} ({check}; {p})
  -> look for what works loose or settles; calibrate more often, or declare drift.angle where this
    pace is the rig's own
campaign-unsound rejects
  {subject} is not counted, since calibrate rejects it by itself: {why}
  -> {hint}
campaign-unusable rejects
  {subject} takes no part, since it cannot be used as a campaign of this rig: {why}
  -> mend {subject} or leave it out: {hint}
campaign-postures-rejected rejects
  {number:.0f} of {postures} postures of {subject} had to be rejected, above the limit of
  {limit:.0%}
campaign-left-out warns
  {subject} takes no part, since calibrate rejects it by itself: {why}
campaign-remark warns
  {subject}: {said}
turn-suspected warns
  {subject} may have turned since {since} ({p}), by less than raises an alarm
  -> validate on a further log without contact, or calibrate the later campaigns apart
turns-visible notes
  of turns since {subject} those of {size} or more, whatever the angle, would have raised an alarm
    with {power:.0%} probability
tare-common notes
  {subject}: their zeros agree as if nobody had tared between them, and the error of that tare
  counts once
campaign-noisy warns
  {subject} scatters {number:.2g} times as much as is stated, and counts with that
checks-undated warns
  nothing says when it was recorded, and the file's date stands for it: {subject}
  -> write each one's day as `campaign.date` in its rig.yaml
check-silent notes
  {subject} leaves {sensors} undetermined and says nothing of it
sensor-never-determined warns
  {subject}: no check determines the mounting of its sensor, which lacks an axis; it has no angles,
  and its turn raises no alarm
sensor-overdue warns
  the certificate of {subject}'s sensor ended on {due}{before:, before ~|}
  -> have it calibrated, and state the new `sensor.due` in rig.yaml
home-unknown warns
  home is unknown ({why}): these coordinates are about (0, 0, 0) of the BCS
  -> state the LCS origin at home, --home X,Y,Z
path-in-contact rejects
  {subject}: the wrench reaches {size} in {axis} at {time:.4g} s of the path, where {limit:.3g} is
  the most without contact{zeros:|: something touched, zeros have moved, or a sensor has}
  ? zeros : zeros that moved by up to {zeros:N} explain it, and so would a contact that stays
  -> {zeros:if nothing touched it, take the new zeros in|drive it free, or ask which: tdfscal
    validate; where the calibration still holds and zeros have moved, take the new ones in}:
    `{line}`
path-touched notes
  from {begin:.2f} to {end:.2f} s after its beginning the log shows {size} and {moment:N·m} about
  the barycentre that the model does not know (contact, or a motion too fast for it)
  -> {free:drive the path free of contact; where nothing touched, drive slower|}
path-zeros-moved rejects
  {subject}: {size} in {axis} stand on the whole path, as zeros make that have moved since the
  calibration, or a contact that stays: false stops are more than twice as many as asked for
  -> if nothing touched it, take the new zeros in: `{line}`
moves-beyond rejects
  {subject}: while the path moves, the wrench reaches {size} in {axis} (at {time:.4g} s), where
  {limit:.3g} is the most that noise and calibration explain: motion adds it, or a contact. The
  thresholds do not count it, so the machine would stop itself
  -> {unstated:state `terminal.inertia` in rig.yaml, with `value: [[Ixx, Ixy, Ixz], [Ixy, Iyy, Iyz],
    [Ixz, Iyz, Izz]]` and `std`, kg m² about the LCS origin, or |}drive slower
threshold-unbounded rejects
  {subject}: no threshold can be given, since zeros, load or their drift are unknown
  -> tare or weigh, and state it in the rig file
covariance-in-part warns
  {subject} has no joint covariance: angles, zeros and load are taken as independent, and the
  thresholds come out too high
  -> calibrate anew
zeros-aged warns
  the zeros are {days:.3g} days old: their drift makes {number:.0%} of the uncertainty of the wrench
  -> tare, or calibrate anew
drift-undeclared warns
  the zeros are {number:.3g} days old and the rig file declares no drift, so that they count as if
  they had not moved since
  -> tare, or declare drift in the rig file
path-inertia-unknown notes
  the rig file states no inertia of the terminal: the thresholds do not count the wrench that its
  motion adds
  -> state `terminal.inertia` in rig.yaml, with `value: [[Ixx, Ixy, Ixz], [Ixy, Iyy, Iyz],
    [Ixz, Iyz, Izz]]` and `std`, kg m² about the LCS origin, or watch for contact at rest only
path-without-noise warns
  {planned:a plan has no samples|the path shows no noise of samples}{filtered: behind a filter of ~
  Hz, for it rests too briefly|}, so that these sizes are too low for the thresholds of a machine
  -> take a {planned:|longer }recorded log of a free path{filtered:, or a higher filter|}
contact-unseen rejects
  of {subject} the smallest contact seen is {size}, and {limit:.3g} must be seen
  (acceptance.contact)
  -> lower what its shares name: tare, filter, or calibrate with more postures and a harder squeeze
"""),
}
