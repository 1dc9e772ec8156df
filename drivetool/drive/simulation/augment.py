"""Smooth laws added to a piecewise affine system: three more states per law, and the arrays of the laws.

Over a stretch of time a law's torque is a parabola: value, slope and curvature are states, a chain of integrators.
So the system stays piecewise affine, and the exact kernel simulates it.
"""

from __future__ import annotations

import numpy as np

from drivetool.drive import Assembly, Drive, Dual, Law, Layout
from drivetool.drive.arrays import MAX_SIZED_LAWS, MOST_STATES, SIZED_STATE_COUNTS, Laws, System
from drivetool.drive.compile import address
from drivetool.drive.effects import LAW_TORQUES
from drivetool.drive.simulation.simulate import Plant

STATES_PER_LAW = 3  # value, slope and curvature of a parabola
# Shortest part of a sample before the dead time switches: a parabola over zero length is undefined.
MIN_PART_FRACTION = 1e-3
# Rate of the fastest mode times the longest piece of a sample. A choice: over longer pieces the parabola is too
# inaccurate, shorter ones cost time.
MAX_PIECE_RATE = 0.7
# Time constants in a sample beyond which a faster decay needs no shorter piece: e^-2 is left at its end.
MAX_DECAY_CONSTANTS = 2.0


def plant_of(drive: Drive, layout: Layout) -> Plant:
    """The drive with a layout, ready to simulate."""
    assembly = Assembly(drive, layout)
    dead_time = 0.0 if assembly.dead_time is None else assembly.dead_time.v
    return Plant(*augmented(assembly), int(dead_time / layout.step + 1e-9), assembly.interpolation)


def augmented(assembly: Assembly) -> tuple[System, Laws | None]:
    """The system with the states of its laws, and the laws; None if it has none."""
    if not assembly.laws:
        return assembly.system(), None
    plain = assembly.system()
    system = _with_law_states(assembly, assembly.system(_pieces(plain, assembly.law_rate), MIN_PART_FRACTION))
    return system, _law_arrays(assembly, system, plain.nx)


def _pieces(s: System, law_rate: float) -> int:
    """Into how many pieces a sample is cut: by the fastest mode with all contacts closed."""
    a_matrix = s.rows[:, :s.nx, 0] / s.mass[:, :1]
    for g in range(s.ng):
        for e in range(2):
            row = s.gap_rows[g, e]
            a_matrix[row] += s.gap_gain[g, e, 0] * s.spring[g, :, 0] / s.mass[row, 0]
    modes = np.linalg.eigvals(a_matrix) if np.isfinite(a_matrix).all() else np.zeros(1)
    # An oscillation that is much faster than the sampling, or decays that fast, leaves no trace in the record.
    decay = np.minimum(np.abs(modes.real) * s.part_lengths.max(), MAX_DECAY_CONSTANTS)
    rates = np.hypot(modes.imag * s.part_lengths.max(), decay)
    return int(np.clip(np.ceil(rates.max() * law_rate / MAX_PIECE_RATE), 1, 20))


def _with_law_states(assembly: Assembly, s: System) -> System:
    n, more, jet = s.nx, STATES_PER_LAW * len(assembly.laws), 1 + s.nq
    nx = n + more
    rows = np.zeros((nx, s.rows.shape[1] + more, jet))
    rows[:n, :n], rows[:n, nx:] = s.rows[:, :n], s.rows[:, n:]
    outputs = _padded_rows(s.outputs, nx)
    transmitted = np.zeros((s.nt, s.rows.shape[1] + more, jet))
    transmitted[:, :n], transmitted[:, nx:] = s.transmitted[:, :n], s.transmitted[:, n:]
    for m, law in enumerate(assembly.laws):
        value = n + STATES_PER_LAW * m
        rows[value, value + 1, 0] = rows[value + 1, value + 2, 0] = 1.0
        for row, factor in _law_rows(assembly, law):
            rows[row, value] += factor.jet()
        for t, body in enumerate(sorted(assembly.losses)):
            if law.shaft == body - 1 if body else law.drives:
                transmitted[t, value, 0] = 1.0
        for k, role in enumerate(assembly.layout.outputs):
            if law.shaft >= 0 and role.endswith("torque") and law.shaft == assembly.shaft_of(role):
                outputs[k, value, 0] = 1.0
    mass = np.zeros((nx, jet))
    mass[:n], mass[n:, 0] = s.mass, 1.0
    picks = np.where(outputs[:, n:, 0].any(axis=1), -1, s.output_state)
    return s._replace(rows=rows, mass=mass, spring=_padded_rows(s.spring, nx),
                      open_guard=_padded_rows(s.open_guard, nx), transmitted=transmitted, outputs=outputs,
                      output_state=picks, memory=np.concatenate([s.memory, np.ones(more)]), nx=nx)


def _padded_rows(rows: np.ndarray, nx: int) -> np.ndarray:
    """rows (k, n, jet) over more states."""
    padded = np.zeros((rows.shape[0], nx, rows.shape[2]))
    padded[:, :rows.shape[1]] = rows
    return padded


def _law_rows(assembly: Assembly, law: Law) -> list[tuple[int, Dual]]:
    """Rows that the torque of a law acts on, and the factor."""
    if law.into:
        return list(law.into.items())
    if law.shaft < 0:
        return [(law.body, assembly.number(1.0))]
    return [(law.shaft, -1.0 / assembly.shafts[law.shaft][2]), (law.shaft + 1, assembly.number(1.0))]


def _law_arrays(assembly: Assembly, s: System, first: int) -> Laws:
    nl, jet = len(assembly.laws), 1 + s.nq
    most_parameters = max(len(law.parameters) for law in assembly.laws)
    arguments, parameters = np.zeros((nl, 2, s.nx, jet)), np.zeros((nl, most_parameters, jet))
    gap, friction = np.full(nl, -1, np.int64), np.full(nl, -1, np.int64)
    half_gap, frictions = np.zeros((nl, jet)), sorted(assembly.frictions)
    for m, law in enumerate(assembly.laws):
        for k, row in enumerate((law.first, law.second)):
            for column, factor in row.items():
                arguments[m, k, column] = factor.jet()
        for k, parameter in enumerate(law.parameters):
            parameters[m, k] = parameter.jet()
        if law.shaft in assembly.gaps:
            gap[m] = list(assembly.gaps).index(law.shaft)
            half_gap[m] = assembly.gaps[law.shaft].jet()
        if law.slides:
            friction[m] = frictions.index(law.body)
    arguments_vary = arguments[..., 1:].any(axis=(1, 2, 3)).astype(np.int64)
    code = np.array([LAW_TORQUES.index(law.torque) for law in assembly.laws], np.int64)
    ns = s.ns
    sized = f"_{first}_{nl}" if s.nu == 1 and first <= MOST_STATES and nl <= MAX_SIZED_LAWS else ""
    in_output = bool(s.outputs[:, first:, 0].any())
    return Laws(
        code, arguments, parameters, gap, half_gap, arguments_vary, friction, first, in_output,
        np.zeros((3, nl, 3 + most_parameters)), np.zeros((2 * nl, 2 * nl)), np.zeros((2 * nl, 2 * nl)),
        np.zeros((2 * nl, 1)), np.zeros((2 * nl, ns)),
        np.zeros((nl, s.nx)), np.zeros((nl, s.nx)), np.zeros((nl, s.nx)), np.zeros((first, ns)),
        np.zeros((3, s.nx, ns + 2 * nl)), np.zeros((2, s.nx, ns + 2 * nl)),
        address("law_torque"), *(address(unit + sized) for unit in ("law_motion", "law_columns", "law_transition")),
        *(address(f"{unit}_{first}" if first in SIZED_STATE_COUNTS else unit)
          for unit in ("covariance_step", "premultiply")),
        address("step_through_law_events"), address("write_law_torques") if in_output else 0)

