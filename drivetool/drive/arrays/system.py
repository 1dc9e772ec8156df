"""A piecewise affine system: what the kernel simulates, and the cache it fills.

Within a mode the state obeys M dx/dt = Q z, z = [x, inputs, 1]. A mode has one digit per
element, gaps first: 0 contact on the positive side, 1 open, 2 contact on the negative side; then
frictions: 0 slip forward, 1 stick, 2 slip backward.

A jet is a number followed by its derivatives over the nq free parameters, along the last axis.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from drivetool.drive.arrays.table import Float1, Float2, Float3, Float4, Int1, Int2

ORDER = 11  # of the power series between events; rate * time <= 1/2, so the rest is below 1e-12
CAPACITY = 256  # modes kept; a chain has 3^(gaps + frictions), of which a record visits a few
PARAMETERS = 4  # of a smooth law, at most
WIDE, NARROW = 8, 4  # columns that are carried from sample to sample at a time, and what may be left of them
MADE_FOR = range(3, 8)  # numbers of states for which, with one input, there is code made for just so many
MOST_STATES, MOST_LAWS = 7, 4  # the same with smooth laws
LOOKS = 8  # most instants inside a sample at which a guard is looked at


class System(NamedTuple):
    """nx states, nu inputs, nz = nx + nu + 1, ng gaps, nf frictions, ny outputs, ns columns.

    The first `plain` states are the drive's; behind them lie those of the smooth laws.

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

    rows: Float3
    mass: Float2
    spring: Float3
    reach: Float2
    gap_rows: Int2
    gap_gain: Float3
    slip_rows: Int1
    level: Float2
    outputs: Float3
    output_gap: Int1
    picks: Int1
    spans: Float1
    early: int
    delay: Float1
    memory: Float1
    nx: int
    nu: int
    nq: int
    ng: int
    nf: int
    ny: int
    ns: int
    plain: int


class Laws(NamedTuple):
    """The smooth nonlinear torques of a system; nl laws.

    The torque of a law over a stretch is a parabola in time, carried by three states at the end of
    the state. So a stretch is linear again and the exact kernel takes it. Where the flow is worked with,
    they are value, slope and bend; where a whole part of a sample is stepped over, the torques at its start,
    its middle and its end, and the columns of leap, mid and watch are over these.

    code        (nl,)                    which law of LAW_TORQUES
    arguments   (nl, 2, nx, 1 + nq)      its two arguments over the state
    parameters  (nl, PARAMETERS, 1 + nq)
    gap         (nl,)                    gap whose contact it belongs to, or -1
    half        (nl, 1 + nq)             half gap taken off the first argument in contact
    turns       (nl,)                    whether its arguments depend on a free parameter
    friction    (nl,)                    friction in whose slip it acts, or -1
    first       ()                       first of the 3 nl states
    shown       ()                       whether an output contains the torque of a law

    Scratch: found (3, nl, 3 + PARAMETERS) torques and derivatives at start, middle and end;
    weight, spare (2 nl, 2 nl) and change (2 nl, 1), right (2 nl, ns), the equations of the torques at middle and
    end and of their sensitivities; slopes, begun, middle (nl, nx); after (first, ns); nodes (3, nx, ns + 2 nl) and
    term (2, nx, ns + 2 nl)

    torque, motion, columns, transition, spread, join, rough, show    addresses of the units law_torque, law_motion,
    law_columns, law_transition, spread, join, law_rough_step and show
    """

    code: Int1
    arguments: Float4
    parameters: Float3
    gap: Int1
    half: Float2
    turns: Int1
    friction: Int1
    first: int
    shown: bool
    found: Float3
    weight: Float2
    spare: Float2
    change: Float2
    right: Float2
    slopes: Float2
    begun: Float2
    middle: Float2
    after: Float2
    nodes: Float3
    term: Float3
    torque: int
    motion: int
    columns: int
    transition: int
    spread: int
    join: int
    rough: int
    show: int


class Cache(NamedTuple):
    """Matrices of the modes met so far; emptied when full.

    slot   (modes * parts + 1,)     where a mode lies, -1 if nowhere; last: how many there are
    flow   (cap, nx, nz, 1 + nq)    dx/dt = flow z
    leap   (cap, nx, nz)            x after the part of a sample = leap z
    dleap  (cap, nx, nz, nq)        its derivative
    wide   (cap, chunks, WIDE nx nz) the same, WIDE columns at a time: rows of so many one behind the other
    net    (cap, nf, nz)            torque on a body without its Coulomb friction
    watch  (cap, elements, LOOKS + 1, nz)  guard value at the start of the part and at instants inside,
           over z at its start
    mid    (cap, nx, nz)            x in the middle of the part, dmid its derivative, wide_mid that in blocks: with
           laws only
    hold   (nf, 1)                  torque up to which friction holds a body at rest
    looks  (cap,)                   how many instants inside there are
    rate   (cap,)                   balanced norm of flow [1/s]

    The last slot is not for a mode but for a step of any length.

    The rest is scratch, for the kernel allocates nothing:
    jets (3, nx, nz, 1 + nq), square (nx, nx), transition (nx, plain and a few more), columns (3, nx, ns),
    series (ORDER + 1, nx), poly (ORDER + 1,), vectors (5, nx), lines (3, nz), guards (elements,), gradient (ns,)

    work_out, rough, late    addresses of the units work_out, rough_step and, where the dead time is
                             free, switch_late; 0 where it is not needed
    """

    slot: Int1
    flow: Float4
    leap: Float3
    dleap: Float4
    wide: Float3
    net: Float3
    watch: Float4
    looks: Int1
    rate: Float1
    mid: Float3
    dmid: Float4
    wide_mid: Float3
    hold: Float2
    jets: Float4
    square: Float2
    transition: Float2
    columns: Float3
    series: Float2
    poly: Float1
    vectors: Float2
    lines: Float2
    guards: Float1
    gradient: Float1
    work_out: int
    rough: int
    late: int


class Pass(NamedTuple):
    """Samples of a record to be simulated, and room for what comes out; all may go on in the next call.

    u, late  (n, nu)         inputs, and those before the dead time switches inside the sample
    y        (n, ny)         measured outputs, NaN where there is none
    gain     (n, ny, nx)     observer gains, or (0, ny, nx) for a free run
    weight   (n, ny)         1/std of the innovations relative to the sensor's, or (0, ny)
    x, big   (nx,), (nx, ns) state and sensitivities, carried on
    mode     (elements,)     carried on; worked out first if `fresh`
    out      (n, ny)         predicted outputs
    jac      (n, ny, ns)     weighted sensitivities, the weighted residual out - y in the last
                             column; or (0, ny, ns)
    states   (n, nx)         state before the sample's measurement is used, or (0, nx)
    """

    u: Float2
    late: Float2
    y: Float2
    gain: Float3
    weight: Float2
    x: Float1
    big: Float2
    mode: Int1
    fresh: int
    out: Float2
    jac: Float3
    states: Float2


class Filtering(NamedTuple):
    """A record to be filtered, and room for what comes out.

    u, late, y  as in a Pass
    r        (ny,)        sensor variances relative to that of the first output
    extra    (nx,)        variance added to each state per sample
    kick     (nx,)        what a torque noise of one leaves in each state after its sample
    p        (plain, plain) covariance of the start state, changed
    x, mode  (nx,), (elements,) changed
    gain     (n, ny, nx)  or (0, ny, nx), left as it is for what lies behind the plain states
    var      (n, ny); innov (n, ny), NaN where unmeasured
    states   (n, nx)      filtered states, or (0, nx)
    """

    u: Float2
    late: Float2
    y: Float2
    r: Float1
    extra: Float1
    kick: Float1
    p: Float2
    x: Float1
    mode: Int1
    gain: Float3
    var: Float2
    innov: Float2
    states: Float2


def empty_cache(s: System, laws: Laws | None, addresses: tuple[int, int, int]) -> Cache:
    """Room for the modes of a system, none of them worked out yet; addresses of its units."""
    nx, nz, jet = s.rows.shape
    elements = s.ng + s.nf
    modes = 3 ** elements * s.spans.size
    cap = min(modes, CAPACITY) + 1
    half = 0 if laws is None else cap
    slot = np.full(modes + 1, -1, np.int64)
    slot[-1] = 0
    return Cache(slot, np.zeros((cap, nx, nz, jet)), np.zeros((cap, nx, nz)),
                 np.zeros((cap, nx, nz, jet - 1)), np.zeros((cap, -(-(jet - 1) // WIDE), WIDE * nx * nz)),
                 np.zeros((cap, s.nf, nz)),
                 np.zeros((cap, elements, LOOKS + 1, nz)), np.zeros(cap, np.int64), np.zeros(cap),
                 np.zeros((half, nx, nz)), np.zeros((half, nx, nz, jet - 1)),
                 np.zeros((half, -(-(jet - 1) // WIDE), WIDE * nx * nz)), s.level[:, :1].copy(),
                 np.zeros((3, nx, nz, jet)), np.zeros((nx, nx)), np.zeros((nx, -(-s.plain // NARROW) * NARROW)),
                 np.zeros((3, nx, s.ns)),
                 np.zeros((ORDER + 1, nx)), np.zeros(ORDER + 1), np.zeros((5, nx)),
                 np.zeros((3, nz)), np.zeros(elements), np.zeros(s.ns), *addresses)
