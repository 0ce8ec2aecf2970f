"""What is said of a tracker's survey, and of point files."""

from __future__ import annotations

from tdfscal.catalogue.entry import Entry

SURVEY: dict[str, Entry] = {
    "columns-unused": Entry("notes", "{subject}: columns not used: {columns}"),
    "columns-assumed": Entry("notes", "{subject}: no line names the columns; read as {columns}"),
    "column-of-reflectors": Entry(
        "notes", "{subject}: the column Target holds reflectors ({reflector}), not points"
    ),
    "points-numbered": Entry(
        "notes", "{subject}: the points have no names; they are numbered by their rows"
    ),
    "measurements-averaged": Entry(
        "notes",
        "{subject}: {measurements} measurements of {points} points are averaged; they scatter by "
        "{scatter:.3g} per coordinate in the file's unit",
    ),
    "uncertainty-expanded": Entry(
        "notes",
        "{subject}: U(95) is taken as an expanded uncertainty, u = U(95)/{coverage:g}",
    ),
    "uncertainty-sigma": Entry(
        "notes", "{subject}: its uncertainties are of {coverage:g} sigma, as it says"
    ),
    "uncertainty-standard": Entry(
        "notes",
        "{subject}: its uncertainties are taken as standard ones (1 sigma); no line says more",
    ),
    "uncertainty-rounded": Entry(
        "notes", "{subject}: uncertainties printed as 0 are taken as {rounded:g}, as rounded"
    ),
    "uncertainty-missing": Entry("notes", "{subject}: {number:.0f} point(s) have no uncertainty"),
    "uncertainty-unstated": Entry(
        "notes", "{subject}: its uncertainties are all {zero:zero|blank}, which states none"
    ),
    "point-left-out": Entry(
        "warns",
        "{subject} is left out: residual {size}, {ratio:.3g} times what its uncertainty allows",
        "measure it again",
    ),
    "point-apart": Entry(
        "warns",
        "{subject} is left out: residual {size}, {ratio:.3g} times what the other points allow",
        "measure it again",
    ),
    "points-left-out": Entry("warns", "{number:.0f} more points are left out"),
    "points-not-measured": Entry("warns", "{subject}: not measured: {points}"),
    "points-without-reference": Entry(
        "warns", "{subject}: measured, but without reference: {points}"
    ),
    "group-unknown": Entry("warns", "{file}: group {subject} is no support of the rig"),
    "moves-few": Entry(
        "warns",
        "{file}: {subject} has fewer than two moves; the other NCPs' axes stand for its own",
    ),
    "instrument-understated": Entry(
        "warns",
        "the instrument's noise is {number:.2g} times the stated one; the result is weighted by it",
    ),
    "positioners-understated": Entry(
        "warns",
        "the NCPs' positions scatter by {size} beyond what is stated; the result is weighted by it",
    ),
    "drawing-understated": Entry(
        "warns",
        "the nominal points are off by {size} beyond what is stated; the result is weighted by it",
    ),
    "positioner-axis-faulty": Entry(
        "warns", "{subject}: {axis}: {kind} {size} ± {spread}", "calibrate the positioner"
    ),
    "targets-coplanar": Entry(
        "warns",
        "the targets of {subject} lie in one plane within their uncertainty: a mirrored frame "
        "would not be noticed",
    ),
    "targets-symmetric": Entry(
        "warns",
        "the targets of {subject} are symmetric: as {order} they would fit too, so their distances "
        "do not check their names",
    ),
    "targets-misnamed": Entry(
        "warns",
        "{subject} is turned by {size} from its nominal mounting, far more than its rpy_std allows",
        "check the names of its targets",
    ),
    "targets-swapped": Entry(
        "warns",
        "the targets of {subject} lie nearest to the moves of {other}",
        "check the group names",
    ),
    "uncertainty-from-files": Entry(
        "notes",
        "uncertainties that the point files state stand in place of the instrument's, the "
        "drawing's and the positioners'",
    ),
    "uncertainty-from-file": Entry(
        "notes", "the uncertainties stated in the file stand in place of the instrument's"
    ),
    "scale-fits-better": Entry(
        "warns",
        "a scale of {ppm:+.0f} ± {ppm_std:.0f} ppm fits significantly better",
        "check temperature and units, or let --scale estimate it",
    ),
    "points-coplanar": Entry(
        "warns",
        "the points lie in one plane within their uncertainty: a mirrored frame would not be "
        "noticed",
    ),
    "points-symmetric": Entry(
        "warns", "the points are symmetric: they would fit under other names too"
    ),
    "groups-moved-apart": Entry(
        "warns",
        "{model} of its own for each group ({subject}) fits {ratio:.3g} times better, within "
        "{size} per coordinate: the groups have moved against each other, or are given in frames "
        "of their own",
        "register each by itself",
    ),
}
