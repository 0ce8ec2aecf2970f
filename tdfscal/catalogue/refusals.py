"""What is said where no calibration can be given, by those who calibrate and validate."""

from __future__ import annotations

from tdfscal.catalogue.entry import Entry, entries

#: Why the data do not determine an angle, and what to do.
_WEAK = """
by-prior refuses
  its standard uncertainty, {unknown:more than ±1 rad|±{mrad:.2g} mrad}, is mostly that of its prior
  -> {moving:move for longer|record more postures} or squeeze harder, or widen rpy_std to let the
    data speak
few-postures refuses
  standard uncertainty {unknown:more than ±1 rad|±{mrad:.2g} mrad} from {moving:too short or too
  small a motion|{few:~ postures, which are too few|too few or too similar postures}}
  -> {moving:move for longer|record {least:~ or |}more postures} with more tilt, tare the sensors,
    and weigh the terminal
along-load refuses
  the loads on this sensor stay within {within:.2g}° of one direction, and turning a sensor about
  its load changes nothing
  -> squeeze the NCPs against each other so that the sensors feel sideways loads (they carry
    {carried:{across:.2g} N across it|none}{enough:; about ~ would show it|})
"""

REFUSALS: dict[str, Entry] = {
    **entries(_WEAK, code="angle-%s"),
    **entries(
        _WEAK,
        "{moving:the motion does|the data do} not determine {angles}{determined:, but ~ to"
        " {worst:±rad} (95 %%)|}; for {first}, %s",
        "-> ; `tdfscal plan RIG{moving: --motion|} -o plan.csv` chooses what to drive, "
        "so that every turn is determined",
        code="angles-%s",
    ),
    **entries("""
angles-determined notes
  every angle{but: of a sensor but ~|} is determined by the data; the weakest is {angle} of
  {subject}, {unknown:more than 1 rad|{mrad:.3g} mrad} (standard uncertainty about that axis of the
  BCS)
estimate-unsettled refuses
  the estimate did not settle in {number:.0f} iterations
  -> check mass, hinges and nominal mounting in rig.yaml, and record {moving:a longer motion|more
    postures}
mountings-alike refuses
  two mountings explain the log{alike: about equally well|} (χ² apart by {number:.2g}; chance puts
  the wrong one first with {p}): {mountings}
  ? few ; {few:.0f} postures are too few
  ? same ; {same} stand alike in both
  -> look which it is, write it as `nominal_rpy`, with `rpy_std: 0.2`, in rig.yaml, and calibrate
    again; or record {least:~ or |}more postures, tilted and squeezed, as `tdfscal plan RIG -o
    plan.csv` chooses them: they decide
axes-blind refuses
  the sensors together do not measure forces in all directions, so that the balance of forces and
  moments says nothing of their angles
  -> measure the horizontal forces too, by one sensor at least
  @ rig.yaml, supports.axes
axis-frozen refuses
  the {axis} {axes:axes|axis} of the sensor of {subject} {axes:are|is} frozen: {axes:they stand|it
  stands} at {stuck:.6g} N in all {postures} postures that could be read{left_out: (~ more were left
  out)|}, and the whole log reads {low:.6g} to {high:.6g} N
  ? since , frozen since {since:when}
  -> check the sensor and its amplifier; what is recorded calibrates with `axes: [{others}]` for
    {subject} in rig.yaml, and none for its {axis} {axes:fields|field} in the log block{before:, or
    by the ~ stops before, with --to|}
  @ log forces
axis-saturated refuses
  the {axis} {axes:axes|axis} of the sensor of {subject} {axes:are|is} saturated: {axes:they
  stand|it stands} at {stuck:.6g} N in all {postures} postures that could be read{left_out: (~ more
  were left out)|}
  ? moves , and the whole log reads {low:.6g} to {high:.6g} N
  -> check the range of sensor and amplifier, and squeeze less
  @ log forces
hinges-off refuses
  the NCP positions miss the hinge pattern of rig.yaml by {size}{hinge:: the hinge of ~ is not where
  it is stated, by {by:m}{or_more: or more|}|}{servo:{either:, or|:} the servo coordinates of ~ are
  offset by {by:m}{or_more: or more|}|}{rescaled:{either:, or|:} the positions of ~ are scaled by
  {amount:1} along x, y, z|}{apart:: positions and hinges differ in scale by {by:.2%}|}
  ? fits ; it would fit with {fits}
  ? whole , and so would their forces
  -> {fits:correct the position {whole:and force |}fields of the log block in rig.yaml|measure
    {servo:the datum of the positioner of ~, and the hinges,|the hinges} again ({first} to
    {second} is {logged:.4f} m in the log and {stated_m:.4f} m in rig.yaml), or check the position
    fields and that log and rig.yaml belong together}{lines:{fits::|, or} write ~|}
  @ log positions
terminal-overturned refuses
  the terminal stands on its head in the log: its z axis points downwards
  ? fits ; it would fit with {fits}
  ? whole , and so would their forces
  -> {fits:correct the position {whole:and force |}fields of the log block in rig.yaml|check the
    position fields, and that log and rig.yaml belong together}{lines:: write ~|}
  @ log positions
positions-renamed refuses
  the forces fit with {fits}, and {hinges:as they are only with zeros as large as the weight|not
  with the positions as they are named}
  -> correct the position fields of the log block in rig.yaml{lines:: write ~|}{hinges:, and give
    that coordinate of every hinge and of the barycentre the opposite sign|}
  @ log positions
lengths-rescaled refuses
  the NCPs stand {number:.4g} times as far apart as the hinges of rig.yaml
  ? units , as if the positions were {units}
  -> {foreign:write the metres of one unit as `position_scale` beside each position|{units:state it
    as log.length_unit in rig.yaml|check log.length_unit, the position fields and the hinge
    coordinates}}
  @ log positions
reaction-recorded refuses
  the forces sum to the weight with the wrong sign, as if the sensors recorded the reaction
  -> turn log.force_on in rig.yaml, or state nominal_rpy where a sensor is mounted upside down
  @ log forces
forces-rescaled refuses
  the forces sum to {number:.3g} times the weight of {mass:.6g} kg
  ? unit , as if they were in {unit}{declared: where ~ is declared|}
  -> check log.force_unit, the force fields, the mass, and nominal_rpy
  @ log forces
instants-broken refuses
  no instant has finite numbers in all fields
  -> check the cells of the log; `tdfscal info LOG` names the first that is none
  @ log
forces-exchanged refuses
  the forces fit with {exchange}, and not as they are named; without it the residuals fall from
  {before:.2g} to {after:.2g} times what is stated
  -> {others:trace the cables: where the hinges of rig.yaml come from a log, as those of a draft, it
    may as well be the positions that are exchanged, and no number tells which. Of the forces,
    |}correct the force fields of the log block in rig.yaml, or the cabling{lines:: write
    ~|}{others:; of the positions, write ~, and exchange the hinges of {moved} likewise|}{check:;
    where a sensor was mounted anew, calibrate again|}
  @ log forces
force-rescaled refuses
  {axis:F~|every axis} of {subject} reads {number:.3g} times what the other sensors ask of it{unit:,
  as if it were in ~|}{declared: where ~ is declared|}; without it the residuals fall from
  {before:.2g} to {after:.2g} times what is stated
  -> look at that channel's scaling and amplifier. Write `log.supports.{subject}.force_scale: [x, y,
    z]`, the newtons of one unit of the log on each axis, or leave a faulty one out of `axes`
  @ log forces
zero-tared refuses
  the zero of {subject} jumped by ({jump}) N before posture {first:.0f}{between:time}{tared:, as a
  tare makes it|}; without it the residuals fall from {before:.2g} to {after:.2g} times what is
  stated
  -> {check:tare and record this check again{until:, or validate one part of it, by --to ~|}{cut: or
    --from ~|}|write `zero.std: unknown` for {subject} in rig.yaml{until:, calibrate with --to ~ -o
    before.yaml,|}{cut: and update before.yaml by it with --from ~ -o after.yaml|, and give the rows
    before and behind as two campaigns, each in a folder with a rig.yaml}}
  @ log forces
forces-mirrored refuses
  the forces fit a terminal of {number:.4g} kg: {axis} of every sensor has the opposite sign, or
  sensors record the reaction
  -> correct the force fields (log.force_on for the reaction) in rig.yaml, or the cabling
  @ log forces
postures-unusable refuses
  no posture can be used
  -> check the sensors, and supports.capacity in rig.yaml
  @ log forces
temperature-missing refuses
  zeros are declared to follow the temperature, but the log has none
  -> name the field as log.temperature, or declare drift.time
  @ drift.temperature
temperature-constant refuses
  the temperature is {number:.6g} °C in every posture, so that no slope against it can be known
  -> check the sensor and the field, or take drift.temperature out
  @ log.temperature
rig-supports notes
  its supports are {subject} instead of {others}
rig-serial notes
  its serial is {other} instead of {own}
sensor-exchanged notes
  the sensor of {subject} has serial number {other} instead of {own}
rig-constant notes
  the {what}{of: of ~|} is {other} {unit} instead of {own} {unit}
rigs-differ refuses
  this is another {framed:LCS|rig} than that of {first}: {differences}
  -> {exchanged:another sensor is mounted in another way: calibrate anew and go on from there, or
    correct the serial number|campaigns of one rig state the same supports, hinges and
    uncertainties; {framed:copy the first one's rig.yaml to the others, since each
    draft's LCS leans as its own log does|correct the rig file, or calibrate the rigs one by one}}
rig-uncalibrated refuses
  this {framed:LCS|rig} is not the one that was calibrated: {differences}
  -> {exchanged:another sensor is mounted in another way: calibrate anew, or correct the serial
    number|{framed:name the calibration's own rig.yaml (--rig FILE), since each draft's LCS leans as
    its own log does|correct the rig file (hinges and load in the same LCS), or calibrate this rig}}
linear-axis-missing refuses
  the sensor of {subject} does not measure {axis}, and the linear method needs every component
  -> calibrate by maximum likelihood (--estimator ml)
  @ rig.yaml, supports
linear-postures-few refuses
  the linear method needs {need} postures for {sensors} sensors and finds {number:.0f}
  -> record more postures, or use the default estimator
  @ log
channel-dead refuses
  the {axis} {axes:axes|axis} of the sensor of {subject} {axes:read|reads} {stuck:.6g} N throughout:
  {axes:they are|it is} dead or not connected
  -> check the sensor, its amplifier and the force fields in rig.yaml, or write `axes: [{others}]`
    for {subject} in rig.yaml
  @ log forces
positions-coarse refuses
  the positions are recorded in steps of {step:.3g} µm, which is an error of {error:.2g} µm where
  the NCPs' own is {own:.2g} µm: in motion nothing averages it out
  -> record the positions with all their digits, or calibrate from dwells
  @ log positions
motion-short refuses
  no stretch of {number:.0f} s is left to calibrate from in motion
  -> record half a minute of motion or more, without holes
  @ log
motion-fast refuses
  the NCPs move faster than {number:.2g} Hz, the highest frequency that streams of {rate:.3g} Hz
  show faithfully here
  -> record faster, or move more slowly
  @ log
recorder-not-found refuses
  the moves that the first recorder saw are not found in the recorder {subject}: the two, of
  {first:.1f} s and {second:.1f} s, did not run at the same time, or saw different campaigns
  ? short , or too few moves are left in the shorter, as of a file that was cut short
  -> give the recordings of one campaign (`tdfscal info` shows when each was made), or state
    clock.offset in its log block, as well as it is known
forces-behind refuses
  the forces {late:lag behind|run ahead of} the positions by about {size}: with that, they balance
  far better
  -> give the forces stamps that are {late:earlier|later} by that time
  @ log
recorder-clock-open refuses
  the clock of the recorder {subject} is not determined: with offsets of {likelier:.6f} s and
  {other:.6f} s to the first recorder's clock its moves are explained alike
  -> state clock.offset in its log block as well as it is known, or record moves that do not repeat
recorders-overlap-nowhere refuses
  with clock.offset as it is stated, {offset:.6f} s, the recorder {subject} ran from {begin:.1f} s
  to {end:.1f} s, where the first ran from 0 s to {span:.1f} s: the two do not overlap
  ? found , and their moves agree with an offset of {likelier:.6f} s
  ? reversed : the sign is turned
  -> correct clock.offset (its stamps minus the first's), or give the recordings of one campaign
recorder-clock-misstated refuses
  clock.offset of the recorder {subject} is stated as {offset:.6f} s with a std of {std:.3g} s, and
  its moves are the first recorder's with an offset of {likelier:.6f} s
  ? reversed : the sign is turned
  -> correct clock.offset (its stamps minus the first's), or state its std as unknown
streams-short refuses
  the log is too short to tell a motion
  -> record a few seconds of every stream; check the unit of its time
  @ log
axes-leave-nothing refuses
  the components that the sensors do not measure leave nothing of the balance of forces and moments
  -> measure more axes
delay-changed refuses
  the delay between forces and positions changes within the log, by {ms:.3g} ± {ms_std:.2g} ms: a
  clock was set anew, or samples are missing in one stream
  -> calibrate each part alone
  @ log
dwells-unusable refuses
  no dwell can be used
  @ log forces
noise-unstated refuses
  neither the log nor the rig file states a force noise
  -> set uncertainty.force_noise in rig.yaml
  @ log forces
supports-differ refuses
  the calibrations are of different supports: {subject} and {others}
  -> compare calibrations of the same rig
covariance-singular refuses
  the covariance of the rotations is not positive definite
  -> calibrate again; a rotation that the data do not determine cannot be compared
calibration-unnamed refuses
  stands on a calibration of {date} that is not named
  -> name every calibration since the first, or campaigns instead
points-unmatched refuses
  no point has the same {by} as one of {file}: {measured} against {reference}
  -> name the points alike in both files; `register` also pairs them by --match point or order, and
    by --groups MEASURED=REFERENCE
point-group-missing refuses
  has no group {subject}
  -> its groups are: {groups}
points-uncounted refuses
  has {number:.0f} points where {file} has {other}: they cannot be paired by their order
  -> leave out what only one of the files has, or pair the points by name
points-ungrouped refuses
  has several points {subject}, which their groups alone tell apart
  -> give both files a column `group`, or rename groups by --groups
points-at-instrument refuses
  a measured point lies in the origin of the tracker's frame
  -> export the measured points in the instrument's own frame
registration-few refuses
  points that determine a rotation are too few: {number:.0f}, groups {groups}
  -> measure three points that do not lie on one line
registration-unsettled refuses
  the registration found no minimum
registration-open refuses
  the points do not determine the rotation about ({axis}) in the measured frame:
  {bounded:±{number:.2g} rad|without bound}; within their uncertainty and their residuals they lie
  on one line or in one place, or both sets are of no one body
  -> measure at least three points that span a plane, and see that both sets are of the same ones
points-mirrored refuses
  the measured points are the mirror image of the reference: no rotation takes one to the other, a
  reflection does
  -> look for an axis with the wrong sign
points-alike-off refuses
  the {what} do not fit their reference points, and any of {subject} may be the one that is off
  -> measure them again, and one or two targets more
points-certain refuses
  some {what} have an uncertainty of zero in some direction
  -> state a range and an angle uncertainty of the instrument above zero
points-rescaled refuses
  the {what} differ in size: {mistake}
  -> correct the length unit
points-misnamed refuses
  the names of the {what} do not fit the distances between them; they fit if {order}
  -> correct the names of these points
groups-misnamed refuses
  the {what} of {subject} do not fit its reference points, those of {other} do
  -> correct the group names
groups-apart refuses
  each of the groups {subject} may have a frame of its own
  -> the groups {subject} may have a frame each, as nominal targets have: register one
    at a time, or calibrate sensors with targets by --method tracker
targets-few refuses
  {number:.0f} target(s) of {subject} have both a nominal and a measured position{alone: (~ in one
  of the two files only)|}; three are the least
  -> measure three targets on each sensor, named as in the drawing
moves-none refuses
  no support of the rig has two moves or more
  -> name the groups as the supports: {subject}
points-off refuses
  {number:.0f} of {points} points do not fit the others: {subject}
  -> measure these points again, or state the survey's real uncertainties
"""),
}
