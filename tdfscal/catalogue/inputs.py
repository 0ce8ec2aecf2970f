"""What is said of what is read: logs, clocks, readings, stops that are no dwells; point files and a
tracker's survey.
"""

from __future__ import annotations

from tdfscal.catalogue.entry import Entry, entries

#: Why stops are left out, in a word or two.
STOPS: dict[str, str] = {
    "stop-too-short": "too short",
    "stop-unsettled": "forces never settled",
    "stop-changing": "forces never settled",
    "stop-interrupted": "interrupted",
    "stop-jolted": "jolt",
}

LOGS: dict[str, Entry] = entries("""
samples-few refuses
  the log holds fewer than two samples
  -> record again
times-alike refuses
  most samples of a signal carry one and the same time
  -> record with times that resolve the sample interval
samples-sparse refuses
  by its times the log has a sample every {number:.3g} s; dwells are found where there is one every
  {limit:g} s or oftener
  -> state `rows: postures` in the log block where each row is the mean of a posture, or its
    `time.unit`, such as ms
samples-dense refuses
  by its times the log has {number:.3g} samples a second, as no recorder of forces has
  ? span , and is {span:.2g} s long
  -> in the log block of rig.yaml state `time.unit` as the recorder counts, such as s
  @ log.time.unit
positions-bent warns
  the distances between the NCPs vary by {number:.1%}, as those of no rigid terminal do
  ? fits ; with {fits} they do not, and the hinges are drafted by these
  -> {fits:see in which unit, and by which name, that field is recorded, and write
    {lines}|check the position fields, their signs and their units: the hinges are drafted wrongly}
temperature-unreadable refuses
  a temperature field holds no number
  -> name a field in °C, or none
  @ log.temperature
log-truncated warns
  {subject}: the file ends within a record at byte {byte}, as one that was cut short does: it is
  read as far as it is whole, to {at}
  ? apart ({number:.1f} s)
  -> copy {subject} from {subjects:their recorders|its recorder} again, or record again
recorders-overlap-in-part warns
  {subject} ran {own:.1f} s from {begin:+.1f} s of the first recorder's {span:.1f} s on: the
  {number:.1f} s that both ran are used
  -> see whether a file is missing, or was cut short
log-missing warns
  {subject} describes a log{files: in ~|}, and there is none: all rests on the tracker's survey
  alone
  -> copy the log into the campaign folder, or name it
campaign-misdated warns
  {subject}: campaign.date is {date}, the log's clock says {clock}, which holds
  -> correct the one that is wrong
file-misdated warns
  the name of {subject} says {date}, and the file is of {clock}, which counts, as the log holds no
  date: a copied file has the day of the copy
  -> state the day of recording in rig.yaml: `campaign: {{date: {date}}}`
log-window notes
  the log is used {window} only
recordings-unlisted warns
  {file}: the folder also holds {files}, which {metadata} does not list and which is not read; `ros2
  bag reindex` lists it
samples-not-ascending warns
  {file}: of {count} samples of {subject}, {repeat} repeat the time of the sample before and {back}
  step back by up to {worst:.3g} s; they are left out
stream-gaps warns
  {file}: {gaps} {several_gaps:gaps|gap} of more than {periods:g} periods of {period:.2g} s in
  {subject}, the longest of {number:.3g} s at {at}
streams-late warns
  {file}: {subject} {subjects:begin up to|begins} {number:.3g} s after the others; postures without
  all signals are not used
streams-early warns
  {file}: {subject} {subjects:end up to|ends} {number:.3g} s before the others; postures without all
  signals are not used
header-clock-off warns
  {file}: the header times of {subject} are {number:+.3g} s off the recorder's
header-clock-departs warns
  {file}: of {count} messages of {subject}, {departing} have a header time that departs by more than
  {limit:g} s from its usual offset to the recorder's, by {number:.3g} s at most
readings-alone warns
  {file}: {several:~ readings stand|1 reading stands} alone in the {signal} of {subject} and
  {several:are|is} left out, of {samples}: at {at} {lone:.4g} {lone_unit} follows {before:.4g}
  {lone_unit}, which then returns
readings-zero warns
  the {signal} of {subject} drops to 0, 0, 0 and returns, at {number:.2%} of the samples, as if the
  recorder wrote zeros where it had no reading
  -> let the recorder leave such cells empty
readings-return warns
  readings leave their level and return within a stop in {several:~ places|one place}, first at
  {first:.2f} s
  -> look for wrong samples in the log
dwell-drifts warns
  dwell {begin:.2f} to {end:.2f} s: the position of {subject} drifts by {size} along {axis}
dwell-force-drifts warns
  dwell {begin:.2f} to {end:.2f} s: the force of {subject} drifts by {size} along {axis}
clocks-run-apart warns
  clocks: those of forces and positions run apart by {ppm:.0f} ppm (standard error {ppm_std:.2g}
  ppm): the forces come {begin:s} after the positions at the beginning and {end:s} at the end
  ({moves} moves)
clocks-apart warns
  clocks: the forces follow the motion {size} {late:later|earlier} than the positions (standard
  error {std:s}, {moves} moves)
clocks-together notes
  clocks: no offset of the forces against the positions is left: {size}, standard error {std:s},
  {moves} moves
postures-repeated warns
  {number:.0f} of {postures} postures repeat an earlier one in every digit (first: {later} is
  {earlier}): a recording that is there twice counts once
stop-too-short notes
  too short: at rest for {number:.2f} s, {wanted:.2f} s needed
stop-unsettled notes
  forces never settled in {number:.2f} s at rest
  ? constant : they ring, time constant {constant:.2g} s
  ? frequency , {frequency:.2g} Hz
stop-changing notes
  forces never settled between two changes
stop-interrupted notes
  interrupted: readings leave their level and return
stop-jolted notes
  jolt: a burst of force, excluded from the dwell around it
""")

SURVEY: dict[str, Entry] = entries("""
columns-unused notes
  {subject}: columns not used: {columns}
column-of-reflectors notes
  {subject}: the column Target holds reflectors ({reflector}), not points
points-numbered notes
  {subject}: the points have no names; they are numbered by their rows
uncertainty-expanded notes
  {subject}: U(95) is taken as an expanded uncertainty, k = {coverage:g}
uncertainty-sigma notes
  {subject}: its uncertainties are of {coverage:g} sigma, as it says
uncertainty-standard notes
  {subject}: its uncertainties are taken as standard ones (1 sigma); no line says more
uncertainty-rounded notes
  {subject}: uncertainties printed as 0 are taken as {rounded:g}, as rounded
uncertainty-missing notes
  {subject}: {number:.0f} point(s) have no uncertainty
uncertainty-unstated notes
  {subject}: its uncertainties are all {zero:zero|blank}, which states none
point-left-out warns
  {subject} is left out: residual {size}, {ratio:.3g} times what its uncertainty allows
  -> measure it again
point-apart warns
  {subject} is left out: residual {size}, {ratio:.3g} times what the other points allow
  -> measure it again
points-left-out warns
  {number:.0f} more points are left out
points-not-measured warns
  {subject}: not measured: {points}
points-without-reference warns
  {subject}: measured, but without reference: {points}
group-unknown warns
  {file}: group {subject} is no support of the rig
moves-few warns
  {file}: {subject} has fewer than two moves; the other NCPs' axes stand for its own
survey-scatters warns
  residuals of the {subject} are {number:.2g} times what is stated; the uncertainties are those of
  so much noise
targets-coplanar warns
  the targets of {subject} lie in one plane within their uncertainty: a mirrored frame would not be
  noticed
targets-symmetric warns
  the targets of {subject} are symmetric: as {order} they would fit too, so their distances do not
  check their names
targets-misnamed warns
  {subject} is turned by {size} from its nominal mounting, far more than its rpy_std allows
  -> check the names of its targets
targets-swapped warns
  the targets of {subject} lie nearest to the moves of {other}
  -> check the group names
uncertainty-from-files notes
  uncertainties that the point files state stand in place of the instrument's, the drawing's and the
  positioners'
uncertainty-from-file notes
  the uncertainties stated in the file stand in place of the instrument's
groups-moved warns
  the groups {subject} are shifted against each other by up to {size}: they are no one body
  -> register one group at a time, or check what carries them
scale-fits-better warns
  a scale of {ppm:+.0f} ± {ppm_std:.0f} ppm fits significantly better
  -> check temperature and units
points-coplanar warns
  the points lie in one plane within their uncertainty: a mirrored frame would not be noticed
points-symmetric warns
  the points are symmetric: they would fit under other names too
""")
