"""The shape of a point file as a model: the published JSON Schema, and point files in JSON."""

from typing import Literal, Self

import numpy as np
from pydantic import model_validator

from tdfscal.errors import DataError
from tdfscal.files.field_types import NotNegative, Number, Strict, Text, fault, key
from tdfscal.files.model_errors import checked
from tdfscal.files.points.columns import refuse, to_metres
from tdfscal.files.yaml import parse_document
from tdfscal.records import PointSet


class Point(Strict):
    """One point: the support's name, the point's label, coordinates, standard uncertainties."""

    group: Text = key("name of the support")
    point: Text = key("the point's label")
    x: Number = key("coordinate, in length_unit")
    y: Number = key("coordinate, in length_unit")
    z: Number = key("coordinate, in length_unit")
    ux: NotNegative | None = key("standard uncertainty of x (k = 1); all three or none", None)
    uy: NotNegative | None = key("standard uncertainty of y", None)
    uz: NotNegative | None = key("standard uncertainty of z", None)

    @model_validator(mode="after")
    def _all_or_no_uncertainties(self) -> Self:
        given = [u is not None for u in (self.ux, self.uy, self.uz)]
        if any(given) and not all(given):
            raise fault("gives some of ux, uy, uz only", hint="give all three or none")
        return self


class PointFile(Strict):
    """Points of one file; x, y, z, ux, uy, uz in `length_unit`, ux, uy, uz with k = 1."""

    points: tuple[Point, ...] = key("list of points")
    length_unit: Literal["m", "cm", "mm", "um", "in"] = key(
        "unit of all coordinates and uncertainties"
    )

    @model_validator(mode="after")
    def _distinct(self) -> Self:
        seen: dict[tuple[str, str], int] = {}
        for index, point in enumerate(self.points):
            first = seen.setdefault((point.group, point.point), index)
            if first != index:
                raise fault(
                    f"{point.group}/{point.point} is points[{first}] already",
                    *("points", index),
                    hint="give each point of a group a name of its own",
                )
        return self


def parse_json(text: str, source: str) -> PointSet:
    """Read a point file in JSON. Raises DataError with the place of what is wrong in it."""
    file = checked(PointFile, parse_document(text.encode(), source, DataError), DataError)
    if not file.points:
        refuse(source, "holds no points", "check the export")
    factor = to_metres(file.length_unit, source)
    std = np.array([[p.ux, p.uy, p.uz] for p in file.points], dtype=np.float64)  # None is NaN
    return PointSet(
        group=tuple(p.group for p in file.points),
        point=tuple(p.point for p in file.points),
        xyz=factor * np.array([[p.x, p.y, p.z] for p in file.points]),
        std=None if np.isnan(std).all() else factor * std,
        source=source,
    )
