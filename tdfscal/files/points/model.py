"""The shape of a point file as a model: the published JSON Schema, and point files in JSON."""

from __future__ import annotations

from typing import Literal, Self

from pydantic import model_validator

from tdfscal.files.field_types import NotNegative, Number, Strict, Text, fault, key


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
