"""The calibration file's optional block of all parameters together, and its way to the records."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from tdfscal.files.field_types import Matrix, Numbers, Strict, Text, fault, key
from tdfscal.model.parameters import deviation, layout, nominal, parameter_count, retract
from tdfscal.numerics.least_squares import triangular
from tdfscal.records import BoolArray, ExactMoves, FloatArray, IntArray, Rig, UncertainValue

if TYPE_CHECKING:  # pulls in the estimator, which a file's reader can do without
    from tdfscal.files.calibration.document import Calibration
    from tdfscal.files.calibration.evidence import ExactQuantityResult
    from tdfscal.model.calibrated import Calibrated

_COMPONENTS = {
    "rotation": ("rx", "ry", "rz"),
    "zero": ("zero.x", "zero.y", "zero.z"),
    "sensitivity": tuple(f"sensitivity.{c}" for c in ("xx", "yy", "zz", "yz", "xz", "xy")),
    "mass": ("mass",),
    "barycentre": ("barycenter.x", "barycenter.y", "barycenter.z"),
    "hinge": ("hinge.x", "hinge.y", "hinge.z"),
    "datum": ("datum.x", "datum.y", "datum.z"),
    "tilt": ("gravity.tilt_x", "gravity.tilt_y"),
    "compliance": ("compliance.lateral", "compliance.vertical"),
    "friction": ("hinge_friction",),
    "drift": (),
}
_OF_THE_RIG = ("mass", "barycentre", "tilt", "compliance", "friction")


class Parameters(Strict):
    """Every parameter that was free, with the covariance of all of them together."""

    parameters: tuple[Text, ...] = key("names of rows and columns")
    value: Numbers = key("SI: estimate minus stated value of the embedded rig; rotations 0")
    matrix: Matrix = key("SI: joint covariance; rotations as in `covariance`")
    unscaled: Matrix | None = key(
        "rad²: covariance of the rotations before the Birge ratio scaled it", None
    )


def parameter_order(supports: tuple[str, ...]) -> tuple[str, ...]:
    """Names of all parameters (P,) in the order of `parameters.layout`."""
    groups = (
        (g, ("",) if g in _OF_THE_RIG else [f"{n}." for n in supports])
        for g in layout(len(supports))
    )
    return tuple(
        owner + part for group, owners in groups for owner in owners for part in _COMPONENTS[group]
    )


def turn_parameters(supports: Sequence[str]) -> tuple[str, ...]:
    """Names of the covariance's rows: `ncp1.rx`, `ncp1.ry`, `ncp1.rz`, `ncp2.rx` …."""
    return tuple(f"{name}.{axis}" for name in supports for axis in _COMPONENTS["rotation"])


def parameters_document(given: Calibrated, unscaled: FloatArray | None = None) -> dict[str, Any]:
    """The block of a calibration whose covariance is joint; unscaled : (3n, 3n), rad²."""
    used = np.flatnonzero(np.diagonal(given.covariance))
    order = parameter_order(given.rig.supports)
    start = replace(nominal(given.rig), rotation=given.state.rotation)
    return {
        "parameters": [order[k] for k in used],
        "value": deviation(given.state, start)[used],
        "matrix": given.covariance[np.ix_(used, used)],
        "unscaled": unscaled,
    }


def parameter_rows(
    named: Iterable[str] | None, supports: tuple[str, ...], stand: BoolArray
) -> IntArray:
    """Places of the parameters that a file's matrices are of: of its block, else of turns.

    named : the block's, None without one. stand : (3n,), turns that the file's covariance has.
    """
    if named is None:
        return np.flatnonzero(stand)
    return np.flatnonzero(np.isin(parameter_order(supports), list(named)))


def exact_moves_document(moves: ExactMoves, rows: IntArray) -> dict[str, Any]:
    """A quantity, and moves of the parameters at `rows` by errors of it; None where there are none.

    Independent errors are as good as as many that have the same covariance.
    """
    common, apart = moves.common[rows], moves.apart[rows]
    apart = triangular(apart.T).T if apart.shape[1] > len(rows) else apart
    sides = {"common": common, "apart": apart}
    own = {"name": moves.name, "error": moves.error, "unit": moves.unit}
    return own | {name: side if side.any() else None for name, side in sides.items()}


def exact_moves_from(
    quantities: Iterable[ExactQuantityResult], rows: IntArray, size: int
) -> tuple[ExactMoves, ...]:
    """Read moves (P,) back; rows : of the file's matrices. size : P."""

    def placed(side: Sequence[Sequence[float]] | None) -> FloatArray:
        if side is None:
            return np.zeros((size, 0))
        out = np.zeros((size, len(side[0])))
        out[rows] = side
        return out

    return tuple(
        ExactMoves(one.name, one.error, one.unit, placed(one.common), placed(one.apart))
        for one in quantities
    )


def calibrated_from(block: Parameters, rig: Rig, rotation: FloatArray) -> Calibrated:
    """Read the block back; rotation (n, 3, 3) as the file gives it."""
    place = places(block, rig.supports)
    from tdfscal.model.calibrated import Calibrated

    size = parameter_count(rig.n)
    step, covariance = np.zeros(size), np.zeros((size, size))
    step[place] = block.value
    covariance[np.ix_(place, place)] = block.matrix
    start = replace(nominal(rig), rotation=rotation)
    return Calibrated(
        rig=rig,
        state=replace(retract(start, step), rotation=rotation),
        covariance=covariance,
        open=np.zeros(size, dtype=np.bool_),
        joint=True,
    )


def calibrated(c: Calibration) -> Calibrated:
    """Return the parameters of a calibration file with their covariance."""
    from tdfscal.model.calibrated import independent

    rig = c.rig.record()
    if c.parameters is not None:
        return calibrated_from(c.parameters, rig, c.rotation)
    mass, barycentre = c.terminal.mass, c.terminal.barycenter
    error = c.sensitivity - np.eye(3)
    return independent(
        rig,
        c.rotation,
        c.rotation_covariance,
        zero=UncertainValue(c.zero, c.zero_std),
        mass=UncertainValue(np.array(mass.value), _std([mass.std])[0]),
        barycentre=UncertainValue(np.array(barycentre.value), _std(barycentre.std)),
        sensitivity=error[:, [0, 1, 2, 1, 0, 0], [0, 1, 2, 2, 2, 1]],
    )


def _std(values: Sequence[float | None]) -> FloatArray:
    """Standard uncertainties of the file, ∞ where it has none."""
    return np.array([np.inf if value is None else value for value in values])


def places(block: Parameters, supports: tuple[str, ...]) -> list[int]:
    """Where the block's parameters are among all; raises the model's fault."""
    order = {name: k for k, name in enumerate(parameter_order(supports))}
    for name in block.parameters:
        if name not in order:
            raise fault(f"names no parameter of this rig: {name}", "parameters", "parameters")
    place = [order[name] for name in block.parameters]
    if place != sorted(set(place)):
        raise fault("are not in their order, each once", "parameters", "parameters")
    return place
