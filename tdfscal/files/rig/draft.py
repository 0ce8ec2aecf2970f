"""A rig file for a rig of which only a log is known: complete, and marked where to confirm.

What the log's static postures show are starting points, each to be confirmed from drawings and
weighing: not a calibration.
"""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any, Final

import numpy as np
import yaml

from tdfscal.errors import DataError, visible
from tdfscal.files.field_types import Quantity
from tdfscal.files.rig.recorders import LogBlock
from tdfscal.files.saving import in_utf8, represent_text
from tdfscal.findings import Finding
from tdfscal.frozen import record
from tdfscal.model.postures import mean_shape
from tdfscal.numerics import so3
from tdfscal.records import FloatArray

_ALONG: Final = 0.8  # cosine; a load further off an axis shows no quarter turn
_WIDTH: Final = 90
#: What is said behind the keys of the log block.
_MARKS: Final = {
    "files": "  # confirm: the names of this recorder's files",
    "rows": "  # confirm: each row is one averaged posture",
    "time": "  # confirm: which field is the clock",
    "length_unit": "  # confirm: of the positions",
    "force_unit": "  # confirm: of the forces",
    "force_on": "  # confirm: terminal if readings are the force on it, sensor if its reaction",
    "decimal": "  # confirm",
    "delay": "  # confirm: s, force minus position stamps; in motion",
    "supports": "  # confirm: these fields are this support's",
}

_SUPPORT: Final = """\
  - name: {name}
    hinge: [{hinge}]  # confirm
    zero: {{value: [0, 0, 0], std: [.inf, .inf, .inf]}}  # confirm
    nominal_rpy: [{rpy}]  # confirm
    rpy_std: .inf
"""
_DRAFT: Final = """\
# Drafted by `tdfscal init` from a log. Take each `# confirm` away once its line is
# right: until then `calibrate` says which of them its result rests on.
format: tdfscal-rig/1
name: {name}
# levelness of the BCS, rad per horizontal axis; gravity points along its −Z
gravity: {{magnitude: 9.80665, tilt_std: 0.0005}}  # confirm
terminal:
  # kg, from the forces of {postures} postures; weigh the terminal with all it carries
  mass: {{value: {mass:.6g}, std: {mass_std:g}}}  # confirm
  # m, LCS of the hinges below, x and y from the shares of the load; .inf: the height is
  # unknown. A drawing's barycentre needs the drawing's hinges, too
  barycenter: {{value: [{x:.3f}, {y:.3f}, 0.0], std: [0.02, 0.02, .inf]}}  # confirm
# hinge: m, LCS; from the positions: origin in the middle of the hinges, axes along those
# of the BCS in posture {reference} of {postures}, however that leans; no drawing's axes; the
# distances vary by {spread:.2g} m; better from the terminal's drawing
# zero: N; after a tare its standard uncertainty, such as 0.5
# nominal_rpy: rad; nominal mounting, {mounting}; turns about
# the vertical are calibrate's. rpy_std: rad, how well that is kept; .inf relies on nothing
supports:
{supports}# Standard uncertainties, k = 1, that the log's own scatter cannot show.
uncertainty:
  positioner: 1.0e-5  # confirm: m, repeatability of an NCP per axis
  hinge: 1.0e-4  # confirm: m, per coordinate of each hinge
  datum: 1.0e-4  # confirm: m, constant offset of each servo's coordinates
  force_noise: 0.1  # confirm: N, per axis and posture, beyond the scatter
  force_sensitivity: 0.002  # confirm: relative, gain and crosstalk; the data sheet's
  hinge_moment: 0.0  # confirm: N·m, friction of the hinges
{log}
acceptance:
  angle_std: 5.0e-3  # rad, largest standard uncertainty of any angle that is accepted
  birge_max: 2.0
"""


@record
class RigSketch:
    """Estimates from K static postures of n supports.

    hinge : (n, 3), m, in an LCS at the hinges' centre that is parallel to the BCS at `reference`.
    spread : m, RMS by which the distances of the hinges vary. mass : kg. barycentre : (2,), m, x
    and y in that LCS. nominal_rpy : (n, 3), rad, quarter turns that hold the loads upright; turns
    about the vertical are left to the calibration. upright : (n,), whether a sensor's load lies
    along one of its axes.
    """

    hinge: FloatArray
    spread: float
    mass: float
    barycentre: FloatArray
    nominal_rpy: FloatArray
    upright: tuple[bool, ...]
    reference: int


def sketch_rig(position: FloatArray, force: FloatArray, gravity: float) -> RigSketch:
    """Estimate hinges, weight and mounting; the posture nearest to the mean is the reference.

    position : (K, n, 3), m, BCS; hinge centres. force : (K, n, 3), N on the terminal, sensor
    frames. gravity : m/s².

    Raises DataError where no instant has finite numbers in all fields; others are left out.
    """
    whole = np.isfinite(position).all(axis=(1, 2)) & np.isfinite(force).all(axis=(1, 2))
    if not whole.any():
        raise DataError(Finding("instants-broken"))
    position, force = position[whole], force[whole]
    hinge, reference, spread = mean_shape(position)
    rotation, upright = _mounting(force)
    load = np.einsum("nij,knj->kni", rotation, force)
    # Turns about the vertical leave what is upright as it is.
    total = load.sum(axis=1)[:, 2:] if all(upright) else load.sum(axis=1)
    mass = float(np.median(np.linalg.norm(total, axis=1))) / gravity
    # Moments of vertical forces about the centre of the hinges, at the reference posture.
    share = load[reference, :, 2] / load[reference, :, 2].sum()
    return RigSketch(
        hinge,
        spread,
        mass,
        share @ hinge[:, :2],
        so3.to_rpy(rotation),
        upright,
        int(np.flatnonzero(whole)[reference]),
    )


def _mounting(force: FloatArray) -> tuple[FloatArray, tuple[bool, ...]]:
    """Quarter turns (n, 3, 3) that hold the mean loads upright, and whose lie along an axis."""
    rotation, upright = [], []
    for mean in force.mean(axis=0):
        axis = int(np.abs(mean).argmax())
        lies = mean[axis] != 0 and abs(mean[axis]) >= _ALONG * np.linalg.norm(mean)
        up, level = np.sign(mean[axis]) * np.eye(3)[axis], np.roll(np.eye(3)[axis], 1)
        turn = np.stack([level, np.cross(up, level), up])  # takes that axis to the vertical
        rotation.append(np.eye(3) if not lies or up[2] > 0 else turn)
        upright.append(bool(lies))
    return np.stack(rotation), tuple(upright)


def draft(
    name: str,
    sketch: RigSketch,
    postures: int,
    recorders: Sequence[LogBlock],
    reasons: Sequence[str],
) -> str:
    """Write a rig file's text.

    postures : of which the sketch is. recorders : the log block, and the reasons for what it says.
    """
    if len(recorders) == 1:  # of two recorders it is in the clocks
        delay = {"delay": Quantity(value=0.0, std=0.005)}
        recorders = [recorders[0].model_copy(update=delay)]
    lies = "as the loads lie along the sensors'"
    if not all(sketch.upright):
        lies = "but the loads lie between a sensor's"
    each = zip(named_supports(recorders), sketch.hinge, sketch.nominal_rpy + 0.0, strict=True)
    supports = (
        _SUPPORT.format(
            name=flow(support),
            hinge=", ".join(f"{c:.6f}" for c in place),
            rpy=", ".join(f"{a:.15g}" for a in rpy),
        )
        for support, place, rpy in each
    )
    said = [  # names of fields and files stand in it
        line
        for reason in reasons
        for line in textwrap.wrap(
            visible(reason), _WIDTH, initial_indent="# ", subsequent_indent="# "
        )
    ]
    return _DRAFT.format(
        name=flow(in_utf8(name)),
        postures=postures,
        mass=sketch.mass,
        mass_std=float(f"{0.02 * sketch.mass:.0e}"),
        x=sketch.barycentre[0],
        y=sketch.barycentre[1],
        reference=sketch.reference + 1,
        spread=sketch.spread,
        mounting=f"{lies} axes",
        supports="".join(supports),
        log="\n".join([*said, *log_lines(recorders, _MARKS)]),
    )


def named_supports(recorders: Sequence[LogBlock]) -> tuple[str, ...]:
    """Return the supports that recorders name."""
    return tuple(dict.fromkeys(name for each in recorders for name in each.supports or ()))


def stated_log(recorders: Sequence[LogBlock]) -> Any:
    """Return the `log` block of recorders as plain values: what is stated, and no defaults."""
    blocks = [each.model_dump(mode="json", exclude_unset=True) for each in recorders]
    return blocks[0] if len(blocks) == 1 else blocks


def log_lines(
    recorders: Sequence[LogBlock], marks: Mapping[str, str] = MappingProxyType({})
) -> list[str]:
    """The log block as YAML, or a list of them; marks : what is said behind a key, and supports."""
    log = stated_log(recorders)
    if isinstance(log, dict):
        return ["log:", *_block_lines(log, marks, "  ")]
    lines = ["log:"]
    for block in log:
        first, *rest = _block_lines(block, marks, "    ")
        lines += [f"  - {first.lstrip()}", *rest]
    return lines


def _block_lines(block: Mapping[str, Any], said: Mapping[str, str], indent: str) -> list[str]:
    lines = []
    for key, value in block.items():
        if key != "supports":
            lines.append(f"{indent}{key}: {flow(value)}{said.get(key, '')}")
            continue
        lines.append(f"{indent}supports:")
        for name, fields in value.items():
            lines.append(f"{indent}  {flow(name)}:{said.get('supports', '')}")
            lines += [f"{indent}    {what}: {flow(which)}" for what, which in fields.items()]
    return lines


class _OneLine(yaml.SafeDumper):
    """Writes every text on the line where it stands, whatever it holds."""


_OneLine.add_representer(str, represent_text)


def flow(value: Any) -> str:
    """A value as YAML on one line."""
    layout: dict[str, Any] = {"default_flow_style": True, "sort_keys": False, "width": 1_000_000}
    prints = "\\" not in repr(value)  # all but what steers a terminal stands as it is
    text: str = yaml.dump(value, Dumper=_OneLine, allow_unicode=prints, **layout)
    return text.removesuffix("...\n").strip()
