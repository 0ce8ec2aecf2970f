"""Documents to alter in tests: a rig file as text, a calibration built from closed forms."""

import copy
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

RIG = """\
format: tdfscal-rig/1
name: Rotor-hub rig
serial: RH-02
campaign: {date: "2026-11-21", operator: A. Smith, site: Hall 3, note: after service}
gravity: {magnitude: 9.80665, tilt_std: 0.0}
terminal:
  mass: {value: 500.0, std: 0.2}
  barycenter: {value: [0.01, -0.015, 0.25], std: [0.001, 0.001, 0.001]}
  inertia: {value: [[40.0, 1.0, 0.0], [1.0, 50.0, 0.0], [0.0, 0.0, 30.0]], std: 6.0}
supports:
  - name: ncp1
    hinge: [0.6, 0.0, 0.0]
    zero: {value: [0, 0, 0], std: [0.5, 0.5, 0.5]}
    nominal_rpy: [0, 0, 0]
    rpy_std: .inf
    capacity: [3000, 3000, 5000]
  - name: ncp2
    hinge: [-0.3, 0.5, 0.0]
    rpy_std: 0.1
    axes: [z, x]
    sensor: {serial: 4711, certificate: C-12, due: "2027-03-01"}
  - name: ncp3
    hinge: [-0.3, -0.5, 0.0]
uncertainty:
  positioner: 1.0e-5
  hinge: 2.0e-5
  compliance: {lateral: 1.0e-6, vertical: 5.0e-7}
drift: {time: 0.5, temperature: 0.2, walk: 0.6, angle: 1.0e-4}
log:
  rows: timeseries
  time: {field: t, unit: ms}
  delay: {value: 0.002, std: 0.005}
  temperature: [T1, T2, T3]
  length_unit: mm
  force_unit: kN
  force_on: sensor
  decimal: ","
  supports:
    ncp1: {position: [X1, Y1, Z1], force: [Fx1, Fy1, Fz1]}
    ncp2: {position: /ncp2/position.point, force: /tdfs2/wrench.wrench.force}
    ncp3: {position: [X3, Y3, Z3], force: [Fx3, Fy3, Fz3]}
tracker:
  instrument: {range: 1.0e-5, range_ppm: 5.0, angle_arcsec: 2.0}
  drawing: 1.0e-5
  misalignment: 2.0e-4
  length_unit: mm
  targets: {nominal: tracker/nominal.csv, measured: tracker/targets.csv}
  moves: {servo: tracker/servo.csv, measured: tracker/moves.csv}
acceptance:
  angle_std: 5.0e-3
  identifiable: 0.04
  birge_max: 1.5
  contact: {force: 5.0, torque: 3.0, rpy: [0, 0, 0.1]}
"""

MINIMAL = """\
format: tdfscal-rig/1
name: minimal
terminal: {mass: {value: 500, std: 0}, barycenter: {value: [0, 0, 0.25], std: 0}}
supports:
  - {name: a, hinge: [1, 0, 0]}
  - {name: b, hinge: [0, 1, 0]}
  - {name: c, hinge: [-1, 0, 0]}
"""

NAMES = ("ncp1", "ncp2", "ncp3")
_BASE = "F_bcs = rotation · {}(F_sensor − zero); rotation = Rz(yaw)·Ry(pitch)·Rx(roll)"
CONVENTION = _BASE.format("")
SCALED_CONVENTION = _BASE.format("sensitivity⁻¹ · ")


def angles_of(R: np.ndarray) -> np.ndarray:
    return np.asarray(Rotation.from_matrix(R).as_euler("xyz"))


def angle_stds(R: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """Standard uncertainties of roll, pitch, yaw by central differences of scipy's conversion."""
    step = 1e-5
    columns = [
        (angles_of(turned(R, step, axis)) - angles_of(turned(R, -step, axis))) / (2 * step)
        for axis in range(3)
    ]
    J = np.stack(columns, axis=1)
    return np.asarray(np.sqrt(np.diag(J @ covariance @ J.T)))


def turned(R: np.ndarray, angle: float, axis: int) -> np.ndarray:
    return np.asarray(Rotation.from_rotvec(angle * np.eye(3)[axis]).as_matrix() @ R)


def calibration(rig: dict[str, Any], seed: int = 0) -> dict[str, Any]:
    """Return a calibration file's content for three supports, every optional part present."""
    rng = np.random.default_rng(seed)
    rpy = rng.uniform(-1, 1, (3, 3))
    R = Rotation.from_euler("xyz", rpy).as_matrix()
    root = 1e-4 * rng.normal(size=(9, 9))
    covariance = root @ root.T
    covariance = (covariance + covariance.T) / 2
    blocks = [covariance[3 * i : 3 * i + 3, 3 * i : 3 * i + 3] for i in range(3)]
    std = np.array([angle_stds(R[i], blocks[i]) for i in range(3)])
    angles = [(name, angle) for name in NAMES for angle in ("roll", "pitch", "yaw")]
    wrench = {"rms_before": 30.0, "rms_after": 0.4, "max_before": 60.0, "max_after": 1.1}
    content: dict[str, Any] = {
        "format": "tdfscal-calibration/1",
        "status": "accepted",
        "method": "self",
        "estimator": "ml",
        "created": "2026-11-21T02:00:00Z",
        "measured": {
            "begin": "2026-11-20T23:00:00Z",
            "end": "2026-11-21T01:00:00Z",
            "source": "log",
        },
        "rig": rig,
        "software": {"name": "tdfscal", "version": "0.1.0"},
        "command": "tdfscal calibrate campaign -o calibration.yaml",
        "seed": 0,
        "inputs": [{"path": "log.csv", "sha256": "0" * 64, "bytes": 7, "integrity": "verified"}],
        "convention": CONVENTION,
        "supports": [
            {
                "name": name,
                "rotation": R[i].tolist(),
                "rpy": rpy[i].tolist(),
                "rpy_std": std[i].tolist(),
                "rpy_interval": {
                    "coverage": 0.95,
                    "low": (rpy[i] - 1.96 * std[i]).tolist(),
                    "high": (rpy[i] + 1.96 * std[i]).tolist(),
                },
                "quaternion_xyzw": Rotation.from_matrix(R[i]).as_quat().tolist(),
                "zero": rng.normal(size=3).tolist(),
                "zero_std": [0.1, None, 1 / 3],
            }
            for i, name in enumerate(NAMES)
        ],
        "covariance": {
            "parameters": [f"{name}.{axis}" for name in NAMES for axis in ("rx", "ry", "rz")],
            "definition": "R_true = exp([d]x) · rotation, d in the BCS, rad",
            "matrix": covariance.tolist(),
        },
        "terminal": {
            "mass": {"value": 500.1, "std": 0.1},
            "barycenter": {"value": [0.01, -0.015, 0.25], "std": [1e-5, 1e-4, 1e-3]},
        },
        "fit": {
            "postures": 30,
            "rejected": [{"index": 4, "start": 12.5, "end": 14.0, "reason": "contact"}],
            "chi2": 171.5,
            "dof": 165,
            "p_value": float(chi2.sf(171.5, 165)),
            "birge": (171.5 / 165) ** 0.5,
            "rms_force": 0.3,
            "rms_moment": 0.1,
        },
        "observability": {
            "verdict": "every angle is determined by the data",
            "angles": [
                {"support": s, "angle": a, "std": 3e-4, "prior_std": None, "identified": True}
                for s, a in angles
            ],
        },
        "budget": {
            "sources": ["noise", "zero"],
            "angles": [
                {"support": s, "angle": a, "variance": {"noise": 0.8 * u**2, "zero": 0.2 * u**2}}
                for (s, a), u in zip(angles, std.ravel().tolist(), strict=True)
            ],
        },
        "monte_carlo": {
            "trials": 10_000,
            "tolerance": 5e-6,
            "linear_interval_validated": True,
        },
        "validation": {
            "method": "leave one out",
            "postures": 30,
            "force": wrench,
            "moment": copy.copy(wrench),
        },
        "tracker": {"chi2": 40.0, "dof": 36, "p_value": 0.3, "birge": 1.05, "points": 12},
        "findings": [
            {"code": "campaign-remark", "severity": "warns", "subject": ["ncp1"], "text": text}
            for text in ("Δ: a warning, with a colon", "1e5", "yes", "0x1F")
        ],
    }
    return content
