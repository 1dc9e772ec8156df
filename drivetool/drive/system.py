"""A piecewise affine system: what the kernel simulates, and the cache it fills.

Within a mode the state obeys M dx/dt = Q z, z = [x, inputs, 1]. A mode has one digit per
element, gaps first: 0 contact on the positive side, 1 open, 2 contact on the negative side; then
frictions: 0 slip forward, 1 stick, 2 slip backward.

A jet is a number followed by its derivatives over the nq free parameters, along the last axis.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

ORDER = 11  # of the power series between events; rate * time <= 1/2, so the rest is below 1e-12
CAPACITY = 256  # modes kept; a chain has 3^(gaps + frictions), of which a record visits a few
PARAMETERS = 4  # of a smooth law, at most
LOOKS = 8  # most instants inside a sample at which a guard is looked at


class System(NamedTuple):
    """nx states, nu inputs, nz = nx + nu + 1, ng gaps, nf frictions, ny outputs, ns columns.

    rows        (nx, nz, 1 + nq)  Q without gaps and friction
    mass        (nx, 1 + nq)      M, one where a row is not a body
    spring      (ng, nx, 1 + nq)  torque of the closed contact over the state
    reach       (ng, 1 + nq)      ks times half gap: the torque at which the contact closes
    gap_rows    (ng, 2)           bodies that the shaft torque acts on
    gap_gain    (ng, 2, 1 + nq)   by which factor: -1/ratio and 1
    slip_rows   (nf,)             bodies with Coulomb friction
    level       (nf, 1 + nq)      its level
    outputs     (ny, nx, 1 + nq)  y = C x
    output_gap  (ny,)             gap whose torque adds to the output, or -1
    picks       (ny,)             state that the output is, or -1 if it is more than a state
    spans       (parts,)          lengths of the parts of a sample [s]
    early       ()                parts before the dead time switches the torque inside a sample
    delay       (nq,)             d(dead time)/d(parameter)
    memory      (nx,)             factor on a state from sample to sample
    """

    rows: np.ndarray
    mass: np.ndarray
    spring: np.ndarray
    reach: np.ndarray
    gap_rows: np.ndarray
    gap_gain: np.ndarray
    slip_rows: np.ndarray
    level: np.ndarray
    outputs: np.ndarray
    output_gap: np.ndarray
    picks: np.ndarray
    spans: np.ndarray
    early: int
    delay: np.ndarray
    memory: np.ndarray
    nx: int
    nu: int
    nq: int
    ng: int
    nf: int
    ny: int
    ns: int


class Laws(NamedTuple):
    """The smooth nonlinear torques of a system; nl laws.

    The torque of a law over a stretch is a parabola in time, carried by three states at the end of
    the state: value, slope, bend. So a stretch is linear again and the exact kernel takes it.

    code        (nl,)                    which law
    arguments   (nl, 2, nx, 1 + nq)      its two arguments over the state
    parameters  (nl, PARAMETERS, 1 + nq)
    gap         (nl,)                    gap whose contact it belongs to, or -1
    half        (nl, 1 + nq)             half gap taken off the first argument in contact
    friction    (nl,)                    friction in whose slip it acts, or -1
    first       ()                       first of the 3 nl states
    shown       ()                       whether an output contains the torque of a law

    Scratch: found (3, nl, 3 + PARAMETERS) torques and derivatives at start, middle and end;
    weight (2 nl, 2 nl) and right (2 nl, ns), the equations of the sensitivities; slopes (nl, nx);
    nodes (3, nx, ns), unit (nx, 3 nl), answers (3, nx, 3 nl), term and more (nx, ns or 3 nl)
    """

    code: np.ndarray
    arguments: np.ndarray
    parameters: np.ndarray
    gap: np.ndarray
    half: np.ndarray
    friction: np.ndarray
    first: int
    shown: bool
    found: np.ndarray
    weight: np.ndarray
    right: np.ndarray
    slopes: np.ndarray
    nodes: np.ndarray
    unit: np.ndarray
    answers: np.ndarray
    term: np.ndarray
    more: np.ndarray


class Cache(NamedTuple):
    """Matrices of the modes met so far; emptied when full.

    slot   (modes * parts + 1,)     where a mode lies, -1 if nowhere; last: how many there are
    flow   (cap, nx, nz, 1 + nq)    dx/dt = flow z
    leap   (cap, nx, nz)            x after the part of a sample = leap z
    dleap  (cap, nx, nz, nq)        its derivative
    net    (cap, nf, nz)            torque on a body without its Coulomb friction
    watch  (cap, elements, LOOKS, nz)  guard value at instants inside the part, over z at its start
    mid    (cap, nx, nz)            x in the middle of the part, dmid its derivative: with laws only
    hold   (nf, 1)                  torque up to which friction holds a body at rest
    looks  (cap,)                   how many of these instants there are
    rate   (cap,)                   balanced norm of flow [1/s]

    The last slot is not for a mode but for a step of any length.

    The rest is scratch, for the kernel allocates nothing:
    jets (3, nx, nz, 1 + nq), square, transition (nx, nx), columns (3, nx, ns), series (ORDER + 1, nx),
    poly (ORDER + 1,), vectors (3, nx), lines (3, nz), guards (2, elements), gradient (ns,)
    """

    slot: np.ndarray
    flow: np.ndarray
    leap: np.ndarray
    dleap: np.ndarray
    net: np.ndarray
    watch: np.ndarray
    looks: np.ndarray
    rate: np.ndarray
    mid: np.ndarray
    dmid: np.ndarray
    hold: np.ndarray
    jets: np.ndarray
    square: np.ndarray
    transition: np.ndarray
    columns: np.ndarray
    series: np.ndarray
    poly: np.ndarray
    vectors: np.ndarray
    lines: np.ndarray
    guards: np.ndarray
    gradient: np.ndarray


def empty_cache(s: System, laws: Laws | None = None) -> Cache:
    """Room for the modes of a system, none of them worked out yet."""
    nx, nz, jet = s.rows.shape
    elements = s.ng + s.nf
    modes = 3 ** elements * s.spans.size
    cap = min(modes, CAPACITY) + 1
    half = 0 if laws is None else cap
    slot = np.full(modes + 1, -1, np.int64)
    slot[-1] = 0
    return Cache(slot, np.zeros((cap, nx, nz, jet)), np.zeros((cap, nx, nz)),
                 np.zeros((cap, nx, nz, jet - 1)), np.zeros((cap, s.nf, nz)),
                 np.zeros((cap, elements, LOOKS, nz)), np.zeros(cap, np.int64), np.zeros(cap),
                 np.zeros((half, nx, nz)), np.zeros((half, nx, nz, jet - 1)), s.level[:, :1].copy(),
                 np.zeros((3, nx, nz, jet)), np.zeros((nx, nx)), np.zeros((nx, nx)),
                 np.zeros((3, nx, s.ns)),
                 np.zeros((ORDER + 1, nx)), np.zeros(ORDER + 1), np.zeros((3, nx)),
                 np.zeros((3, nz)), np.zeros((2, elements)), np.zeros(s.ns))
