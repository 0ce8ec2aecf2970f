"""What is said of logs: files, clocks, readings, stops that are no dwells."""

from __future__ import annotations

from tdfscal.catalogue.entry import Entry

#: Why stops are left out, in a word or two.
STOPS: dict[str, str] = {
    "stop-too-short": "too short",
    "stop-unsettled": "forces never settled",
    "stop-changing": "forces never settled",
    "stop-interrupted": "interrupted",
    "stop-jolted": "jolt",
    "stop-repeated": "readings repeated",
}

LOGS: dict[str, Entry] = {
    "log-truncated": Entry(
        "warns",
        "{file}: the file ends within a record at byte {byte}, as one that was cut short does: it "
        "is read as far as it is whole, to {at} s",
    ),
    "recorders-overlap-in-part": Entry(
        "warns",
        "{subject} holds {begin:.1f} s to {end:.1f} s of the first recorder's {span:.1f} s: what "
        "only one of the two saw is not used",
        "see whether a file of either is missing, or was cut short",
    ),
    "log-window": Entry("notes", "the log is used {window} only"),
    "messages-lost": Entry(
        "warns",
        "{file}: {number:.0f} messages are there where {metadata} states {recorded}: the recorder "
        "has lost some",
    ),
    "recordings-unlisted": Entry(
        "warns",
        "{file}: the folder also holds {files}, which {metadata} does not list and which is not "
        "read; `ros2 bag reindex` lists it",
    ),
    "samples-not-ascending": Entry(
        "warns",
        "{file}: of {count} samples of {subject}, {repeat} repeat the time of the sample before "
        "and {back} step back by up to {worst:.3g} s; they are left out",
    ),
    "stream-gaps": Entry(
        "warns",
        "{file}: {gaps} {several_gaps:gaps|gap} of more than {periods:g} periods of {period:.2g} s "
        "in {subject}, the longest of {number:.3g} s at {at} s",
    ),
    "streams-late": Entry(
        "warns",
        "{file}: {subject} {subjects:begin up to|begins} {number:.3g} s after the others; "
        "postures without all signals are not used",
    ),
    "streams-early": Entry(
        "warns",
        "{file}: {subject} {subjects:end up to|ends} {number:.3g} s before the others; "
        "postures without all signals are not used",
    ),
    "header-clock-off": Entry(
        "warns", "{file}: the header times of {subject} are {number:+.3g} s off the recorder's"
    ),
    "header-clock-departs": Entry(
        "warns",
        "{file}: of {count} messages of {subject}, {departing} have a header time that departs by "
        "more than {limit:g} s from its usual offset to the recorder's, by {number:.3g} s at most",
    ),
    "readings-alone": Entry(
        "warns",
        "{file}: {several:~ readings stand|1 reading stands} alone in the {signal} of {subject} "
        "and {several:are|is} left out, of {samples}: at {at} s {lone:.4g} {lone_unit} follows "
        "{before:.4g} {lone_unit}, "
        "which then returns",
    ),
    "readings-zero": Entry(
        "warns",
        "the {signal} of {subject} drops to 0, 0, 0 and returns, at {number:.2%} of the samples, "
        "as if the recorder wrote zeros where it had no reading",
        "let the recorder leave such cells empty, or repeat the last reading",
    ),
    "readings-return": Entry(
        "warns",
        "readings leave their level and return within a stop in {several:~ places|one place}, "
        "first at {first:.2f} s",
        "look for wrong samples in the log",
    ),
    "dwell-drifts": Entry(
        "warns",
        "dwell {begin:.2f} to {end:.2f} s: the position of {subject} drifts by {size} along {axis}",
    ),
    "dwell-force-drifts": Entry(
        "warns",
        "dwell {begin:.2f} to {end:.2f} s: the force of {subject} drifts by {size} along {axis}",
    ),
    "clocks-run-apart": Entry(
        "warns",
        "clocks: those of forces and positions run apart by {ppm:.0f} ppm (standard error "
        "{ppm_std:.2g} ppm): the forces come {begin:s} after the positions at the beginning and "
        "{end:s} at the end ({moves} moves)",
    ),
    "clocks-apart": Entry(
        "warns",
        "clocks: the forces follow the motion {size} {late:later|earlier} than the positions "
        "(standard error {std:s}, {moves} moves)",
    ),
    "clocks-together": Entry(
        "notes",
        "clocks: no offset of the forces against the positions is seen: {size}, standard error "
        "{std:s}, {moves} moves",
    ),
    "postures-repeated": Entry(
        "warns",
        "{number:.0f} of {postures} postures repeat an earlier one in every digit (first: {later} "
        "is {earlier}): a recording that is there twice counts once",
    ),
    "stop-too-short": Entry(
        "notes", "too short: at rest for {number:.2f} s, {wanted:.2f} s needed"
    ),
    "stop-unsettled": Entry(
        "notes",
        "forces never settled in {number:.2f} s at rest",
        "",
        (
            ("constant", ": they ring, time constant {constant:.2g} s"),
            ("frequency", ", {frequency:.2g} Hz"),
        ),
    ),
    "stop-changing": Entry("notes", "forces never settled between two changes"),
    "stop-interrupted": Entry("notes", "interrupted: readings leave their level and return"),
    "stop-jolted": Entry("notes", "jolt: a burst of force, excluded from the dwell around it"),
    "stop-repeated": Entry("notes", "the readings of {subject} are those of {original:.6g} s"),
}
