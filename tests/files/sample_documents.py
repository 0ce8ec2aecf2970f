"""Rig files as text, to alter in tests."""

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
