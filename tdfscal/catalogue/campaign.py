"""What is said of a self-calibration: of the gate, the campaign, its noise, its postures."""

from __future__ import annotations

from tdfscal.catalogue.entry import Entry

GATE: dict[str, Entry] = {
    "angle-uncertain": Entry(
        "rejects",
        "{angle} of {subject} has a standard uncertainty of {size}, above the limit of {limit:rad}",
    ),
    "residuals-large": Entry(
        "rejects",
        "the residuals are {number:.2g} times what the stated uncertainties explain, above the "
        "limit of {limit:.2g}",
    ),
    "postures-rejected": Entry(
        "rejects",
        "{number:.0f} of {postures} postures had to be rejected, above the limit of {limit:.0%}",
    ),
    "contact-uncertain": Entry(
        "rejects",
        "the contact {subject} at roll, pitch, yaw = {rpy} rad has an expanded uncertainty of "
        "{size} (95.45 %), above the limit of {limit:g}; its error exceeds the limit with a "
        "probability of {exceeding:.1g}",
    ),
    "contact-below-threshold": Entry(
        "warns",
        "of the {subject} that must be told from none, {limit:g}, a machine sees {size} at best: "
        "one false stop in ten hours, 95 % seen, without noise and drift",
        "look along its path: `tdfscal capability`; more postures and a harder squeeze lower it",
    ),
    "motion-left-out": Entry(
        "rejects",
        "{number:.0f} of {seconds:.0f} s had to be left out, above the limit of {limit:.0%}",
    ),
    "halves-disagree": Entry(
        "rejects",
        "the two halves of the log disagree ({p}), most about the {axis} axis of {subject}: {size} "
        "± {std:rad}",
        "see what changed while it moved (a screw, a hinge, a warming sensor: declare drift.time), "
        "and calibrate the two halves of the log apart",
    ),
    "methods-disagree": Entry(
        "rejects",
        "self-calibration and tracker differ beyond their uncertainties (joint {p}), in {above} "
        "of {of} angles by themselves (worst: {angle} of {support}: {difference:+.3g} mrad, E_n = "
        "{en:.2f})",
        "calibrate by each method alone and compare: the tracker sees a sensor's body, "
        "self-calibration its sensing axes (tracker.misalignment states what may lie between)",
    ),
    "channel-broken": Entry(
        "rejects",
        "{channel} scatters by {size}, {factor:.2g} times as much as stated and {share:.1%} of the "
        "load, as no channel that works does: contact (postures {postures}{more:, …|} do not fit), "
        "or a broken channel",
        "find what touched the terminal or a sensor at the postures that do not fit, and record "
        "them again; where nothing did, look at {channel}, its cable and amplifier, or leave that "
        "axis out of `axes` in rig.yaml",
        (("alike", "; about as likely {alike}"),),
    ),
}

POSTURES: dict[str, Entry] = {
    "posture-over-capacity": Entry(
        "warns",
        "the {axis} axis of the sensor of {subject} reaches its capacity of {size}",
        "squeeze less, carry less, or widen the range of sensor and amplifier (or correct "
        "`capacity` in rig.yaml)",
    ),
    "posture-saturated": Entry(
        "warns",
        "the {axis} axis of the sensor of {subject} is saturated at {size}",
        "squeeze less, carry less, or widen the range of sensor and amplifier (or correct "
        "`capacity` in rig.yaml)",
    ),
    "posture-frozen": Entry(
        "warns",
        "the {axis} axis of the sensor of {subject} is frozen at {size}",
        "look at the sensor's cable and amplifier",
    ),
    "posture-misfits": Entry(
        "warns",
        "unexplained force {size} and moment {moment:N·m}, {ratio:.0f} times what is expected: "
        "contact, a hand, or a jolt",
        "find what touched the terminal (cables, a hand, a stop), free it, and record again",
    ),
    "stretch-frozen": Entry(
        "warns",
        "the {axis} axis of the sensor of {subject} is frozen",
        "look at the sensor's cable and amplifier",
        (("end", ": {begin:.2f} to {end:.2f} s of the log were left out"),),
    ),
    "stretch-standing": Entry(
        "warns",
        "the position of {subject} is frozen while others move",
        "look at the recorder's link to that positioner",
        (("end", ": {begin:.2f} to {end:.2f} s of the log were left out"),),
    ),
    "stretch-over-capacity": Entry(
        "warns",
        "a sensor is at its capacity",
        "squeeze less, or carry less",
        (("end", ": {begin:.2f} to {end:.2f} s of the log were left out"),),
    ),
    "stretch-touched": Entry(
        "warns",
        "a wrench of {size} and {moment:N·m} that the model does not know: contact, or a motion "
        "too fast for it",
        "find what touched the terminal, or move more slowly",
        (("end", ": {begin:.2f} to {end:.2f} s of the log were left out"),),
    ),
}

CAMPAIGN: dict[str, Entry] = {
    "draft-unconfirmed": Entry(
        "warns",
        "the result rests on {number:.0f} lines of the rig file to be confirmed: {subject}",
        "confirm these lines, and take the mark behind them out",
    ),
    "terminal-turned": Entry(
        "warns",
        "the terminal stands turned by {degrees:.0f}°{axis: about ~ of the BCS|} in "
        "{always:every posture|most postures}",
        "check that the supports' names in the log are right"
        "{upright:; it would stand upright with ~|}",
    ),
    "sensor-turned": Entry(
        "warns",
        "the sensor of {subject} is turned by {degrees:.0f}° from its nominal mounting",
        "look whether it is, and state nominal_rpy in rig.yaml",
    ),
    "angles-locked": Entry(
        "notes",
        "{subject} is pitched by {degrees:.0f}°, where roll and yaw are one turn: its "
        "uncertainties are those of the turns about X, Y and Z of the BCS",
    ),
    "mounting-open": Entry(
        "warns",
        "{subject}: the axes that are measured leave the mounting of the sensor undetermined, so "
        "that it has no angles; the others stand",
    ),
    "mounting-ambiguous": Entry(
        "warns",
        "another mounting explains the motion about as well, {other}; the nominal one decided",
    ),
    "channels-noisy": Entry(
        "warns",
        "the residuals show more noise than is stated in some channels, and the postures were "
        "weighted by it: {channels}",
        "look at these sensors and their cables",
    ),
    "sensitivity-in-situ": Entry(
        "notes",
        "gain and crosstalk of the sensors were decoupled in situ, from a prior of {number:.2%}: a "
        "reading needs rotation · sensitivity⁻¹",
    ),
    "noise-from-residuals": Entry(
        "warns",
        "neither the log nor rig.yaml states a force noise; it was taken from the residuals, so χ² "
        "cannot warn of contact or a wrong rig file",
        "state uncertainty.force_noise in rig.yaml",
    ),
    "noise-understated": Entry(
        "warns",
        "the residuals are {number:.2g} times what the stated uncertainties explain ({p}); all "
        "noise was scaled up by that factor",
    ),
    "noise-overstated": Entry(
        "warns",
        "the residuals are only {number:.2g} times what the stated uncertainties explain: those "
        "may be overstated (uncertainty.force_noise, positioner), and so the angles' own",
    ),
    "mass-exact": Entry(
        "warns",
        "the mass is called exact, and the zeros rest on it: an error of 0.1 % would move the zero "
        "{zero} by {moved:N}, {shift:.2g} of its standard uncertainties, and hardly a residual",
        "write its own as `terminal.mass.std`, or tare",
    ),
    "barycentre-exact": Entry(
        "warns",
        "the barycentre is called exact, and the zeros rest on it: an error of 1 mm would move the "
        "zero {zero} by {moved:N}, {shift:.2g} of its standard uncertainties, and hardly a "
        "residual",
        "write its own as `terminal.barycenter.std`, or tare",
    ),
    "parabola-estimated": Entry(
        "notes",
        "the residuals ask for more than a slope of the zeros in time: a parabola was estimated "
        "beside it",
    ),
    "trials-unsettled": Entry(
        "warns",
        "{number:.0f} of {trials} Monte Carlo trials did not settle; they count where they ended: "
        "the angles are known so poorly that noise can turn a sensor away",
    ),
    "intervals-by-trials": Entry(
        "notes",
        "Monte Carlo does not confirm the linear 95 % intervals; the intervals given are those of "
        "the trials",
    ),
    "trials-left-out": Entry(
        "notes",
        "the linear intervals of {number:.0f} sensors stand without a Monte Carlo, which takes "
        "minutes",
        "ask for it by --trials",
    ),
    "recording-paused": Entry(
        "warns",
        "no stream has a sample from {begin:.2f} to {end:.2f} s: the recording paused; the motion "
        "is cut there",
    ),
    "clock-jumped": Entry(
        "warns",
        "no stream has a sample from {begin:.2f} to {end:.2f} s: the NCPs go on from where they "
        "stood: the clock of all streams jumped ahead; the motion is cut there",
    ),
    "holes-more": Entry("warns", "{number:.0f} more holes in all streams, cut likewise"),
    "moves-add-nothing": Entry("notes", "the moves add nothing to the dwells: {why}"),
    "stops-left-out": Entry(
        "warns",
        "{number:.0f} of {stops} stops were left out (mostly: {reason})",
        "hold postures for longer, and see that forces and positions share one clock",
    ),
    "stops-over-capacity": Entry(
        "warns",
        "{number:.0f} of {stops} stops were left out (mostly: {reason}), and F{axis} of {subject} "
        "reaches its capacity of {capacity:N}",
        "squeeze less, or widen the range of sensor and amplifier",
    ),
    "samples-repeated": Entry(
        "warns",
        "{number:.0f} of {dwells} dwells repeat earlier readings, noise included, and are left "
        "out: first, at {begin:.6g} s the readings of {subject} are those of {original:.6g} s",
        "give each recording once",
    ),
}
