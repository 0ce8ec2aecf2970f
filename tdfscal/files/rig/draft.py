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
from tdfscal.files.rig.model import RIG_FORMAT
from tdfscal.files.rig.reading import CONFIRM
from tdfscal.files.rig.recorders import LogBlock
from tdfscal.files.saving import in_utf8, represent_text
from tdfscal.findings import Finding
from tdfscal.frozen import record
from tdfscal.model.postures import register
from tdfscal.numerics import so3
from tdfscal.records import FloatArray

_ROUNDS: Final = 10
_ALONG: Final = 0.8  # cosine; a load further off an axis shows no quarter turn
_WIDTH: Final = 90
#: What is said behind the keys of the log block.
_MARKS: Final = {
    "files": f"  # {CONFIRM}: the names of this recorder's files",
    "rows": f"  # {CONFIRM}: each row is one averaged posture",
    "time": f"  # {CONFIRM}: which field is the clock",
    "length_unit": f"  # {CONFIRM}: of the positions",
    "force_unit": f"  # {CONFIRM}: of the forces",
    "force_on": f"  # {CONFIRM}: terminal if readings are the force on it, sensor if its reaction",
    "decimal": f"  # {CONFIRM}",
    "delay": f"  # {CONFIRM}: s, force minus position stamps; in motion",
    "supports": f"  # {CONFIRM}: these fields are this support's",
}

_UNCERTAINTY: Final = (
    "# Standard uncertainties, k = 1, that the log's own scatter cannot show.",
    "uncertainty:",
    f"  positioner: 1.0e-5  # {CONFIRM}: m, repeatability of an NCP per axis",
    f"  hinge: 1.0e-4  # {CONFIRM}: m, per coordinate of each hinge",
    f"  datum: 1.0e-4  # {CONFIRM}: m, constant offset of each servo's coordinates",
    f"  force_noise: 0.1  # {CONFIRM}: N, per axis and posture, beyond the scatter",
    f"  force_sensitivity: 0.002  # {CONFIRM}: relative, gain and crosstalk; the data sheet's",
    f"  hinge_moment: 0.0  # {CONFIRM}: N·m, friction of the hinges",
)


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
    hinge, reference, spread = _shape(position)
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


def _shape(position: FloatArray) -> tuple[FloatArray, int, float]:
    """Mean shape (n, 3) of the hinges, its posture of reference, and its misfit, m.

    Generalised Procrustes: postures are registered on their mean, in turn.
    """
    centred = position - position.mean(axis=1, keepdims=True)
    reference = int(np.argmin(((centred - centred.mean(axis=0)) ** 2).sum(axis=(1, 2))))
    shape = centred[reference]
    for _ in range(_ROUNDS):
        aligned = centred @ register(shape, centred)[0]
        shape = aligned.mean(axis=0)
    spread = float(np.sqrt(((aligned - shape) ** 2).sum(axis=2).mean()))
    turn, _ = register(shape, centred[None, reference])
    return shape @ turn[0].T, reference, spread


def _mounting(force: FloatArray) -> tuple[FloatArray, tuple[bool, ...]]:
    """Quarter turns (n, 3, 3) that hold the mean loads upright, and whose lie along an axis."""
    mean = force.mean(axis=0)
    axis = np.abs(mean).argmax(axis=1)
    along = mean[np.arange(len(mean)), axis]
    upright = np.abs(along) >= _ALONG * np.linalg.norm(mean, axis=1)
    upright &= along != 0
    rotation = [
        _upright(int(i), float(np.sign(load))) if lies else np.eye(3)
        for i, load, lies in zip(axis, along, upright, strict=True)
    ]
    return np.stack(rotation), tuple(upright.tolist())


def _upright(axis: int, sign: float) -> FloatArray:
    """A rotation that takes an axis of the sensor to the vertical."""
    if axis == 2 and sign > 0:
        return np.eye(3)
    up = sign * np.eye(3)[axis]
    level = np.roll(np.eye(3)[axis], 1)
    return np.stack([level, np.cross(up, level), up])


def draft(
    name: str,
    sketch: RigSketch,
    notes: Mapping[str, str],
    recorders: Sequence[LogBlock],
    reasons: Sequence[str],
) -> str:
    """Write a rig file's text.

    notes : what is to be said beside `mass`, `hinge` and `nominal_rpy`. recorders : the log block,
    and the reasons for what it says.
    """
    mass, barycentre = sketch.mass, sketch.barycentre
    if len(recorders) == 1:  # of two recorders it is in the clocks
        delay = {"delay": Quantity(value=0.0, std=0.005)}
        recorders = [recorders[0].model_copy(update=delay)]
    lines = [
        f"# Drafted by `tdfscal init` from a log. Take each `# {CONFIRM}` away once its line is",
        "# right: until then `calibrate` says which of them its result rests on.",
        f"format: {RIG_FORMAT}",
        f"name: {_flow(in_utf8(name))}",
        *_entry("levelness of the BCS, rad per horizontal axis; gravity points along its −Z",
                "gravity: {magnitude: 9.80665, tilt_std: 0.0005}"),
        "terminal:",
        *_entry(f"kg, {notes['mass']}; weigh the terminal with all it carries",
                f"  mass: {{value: {mass:.6g}, std: {float(f'{0.02 * mass:.0e}'):g}}}"),
        *_entry("m, LCS of the hinges below, x and y from the shares of the load; .inf: the height "
                "is unknown. A drawing's barycentre needs the drawing's hinges, too",
                f"  barycenter: {{value: [{barycentre[0]:.3f}, {barycentre[1]:.3f}, 0.0], "
                "std: [0.02, 0.02, .inf]}"),
        *_remark(f"hinge: m, LCS; {notes['hinge']}; better from the terminal's drawing. zero: N; "
                 "after a tare its standard uncertainty, such as 0.5. nominal_rpy: rad; "
                 f"{notes['nominal_rpy']}. rpy_std: rad, how well that is kept; .inf relies on "
                 "nothing"),
        "supports:",
    ]  # fmt: skip
    each = zip(named_supports(recorders), sketch.hinge, sketch.nominal_rpy + 0.0, strict=True)
    for support, place, rpy in each:
        lines += [
            f"  - name: {_flow(support)}",
            f"    hinge: [{', '.join(f'{c:.6f}' for c in place)}]  # {CONFIRM}",
            f"    zero: {{value: [0, 0, 0], std: [.inf, .inf, .inf]}}  # {CONFIRM}",
            f"    nominal_rpy: [{', '.join(f'{a:.15g}' for a in rpy)}]  # {CONFIRM}",
            "    rpy_std: .inf",
        ]
    lines += [
        *_UNCERTAINTY,
        *(line for reason in reasons for line in _remark(reason)),
        *log_lines(recorders, _MARKS),
        "acceptance:",
        "  angle_std: 5.0e-3  # rad, largest standard uncertainty of any angle that is accepted",
        "  birge_max: 2.0",
    ]
    return "\n".join(lines) + "\n"


def _entry(remark: str, line: str) -> list[str]:
    """A line to be confirmed under a remark."""
    indent = line[: len(line) - len(line.lstrip())]
    return [*(indent + text for text in _remark(remark)), f"{line}  # {CONFIRM}"]


def _remark(text: str) -> list[str]:
    # Names of fields and files stand in it.
    return textwrap.wrap(visible(text), _WIDTH, initial_indent="# ", subsequent_indent="# ")


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
            lines.append(f"{indent}{key}: {_flow(value)}{said.get(key, '')}")
            continue
        lines.append(f"{indent}supports:")
        for name, fields in value.items():
            lines.append(f"{indent}  {_flow(name)}:{said.get('supports', '')}")
            lines += [f"{indent}    {what}: {_flow(which)}" for what, which in fields.items()]
    return lines


class _OneLine(yaml.SafeDumper):
    """Writes every text on the line where it stands, whatever it holds."""


_OneLine.add_representer(str, represent_text)


def _flow(value: Any) -> str:
    layout: dict[str, Any] = {"default_flow_style": True, "sort_keys": False, "width": 1_000_000}
    prints = "\\" not in repr(value)  # all but what steers a terminal stands as it is
    text: str = yaml.dump(value, Dumper=_OneLine, allow_unicode=prints, **layout)
    return text.removesuffix("...\n").strip()
