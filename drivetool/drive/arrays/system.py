"""A piecewise affine system: what the kernel simulates, and the cache it fills.

Within a mode the state obeys M dx/dt = Q z, z = [x, inputs, 1]. A mode has one digit per
element, gaps first: 0 contact on the positive side, 1 open, 2 contact on the negative side; then
frictions: 0 slip forward, 1 stick, 2 slip backward; then transmissions with a loss: 0 the torque
transmitted is positive, 1 zero, 2 negative.

A jet is a number followed by its derivatives over the nq free parameters, along the last axis.
A block of code is "sized" if it is compiled for a fixed number of states and one input: its loops are unrolled.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from drivetool.drive.arrays.table import Float1, Float2, Float3, Float4, Int1, Int2

# Order of the power series between events: rate * time <= 1/2, so the remainder 0.5^12/12! is below 1e-12.
SERIES_ORDER = 11
# Modes kept in the cache. A choice: a chain has 3^(gaps + frictions) modes, of which a record visits a few.
MAX_CACHED_MODES = 256
# Columns carried from sample to sample in one block, and width of the blocks of the remaining columns. Powers of
# two: a block of 4 float64 fills a 256-bit vector register, one of 8 two of them.
WIDE_BLOCK, NARROW_BLOCK = 8, 4
# State counts with sized code: from two masses to three with an angle and a disturbance.
SIZED_STATE_COUNTS = range(3, 8)
# Largest state and law counts with sized code for smooth laws. A choice: each pair costs compile time at first use.
MOST_STATES, MAX_SIZED_LAWS = 7, 4
# Largest number of instants inside a sample at which a guard is evaluated. A choice: more of them reject fewer
# event-free samples, and each costs one product with the state.
MAX_GUARD_INSTANTS = 8


class System(NamedTuple):
    """nx states, nu inputs, nz = nx + nu + 1, ng gaps, nf frictions, nt losses, ny outputs, ns columns.

    The first `plain` states are the drive's; the states of the smooth laws follow.

    rows        (nx, nz, 1 + nq)  Q without gaps and friction
    mass        (nx, 1 + nq)      M, one where a row is not a body
    spring      (ng, nx, 1 + nq)  torque of the closed contact over the state
    open_guard  (ng, nx, 1 + nq)  what closes the gap at the reach, over the state; as a rule the spring
    relaxing    (ng, 2)           state of the elastic twist that relaxes in the gap and that of the twist, or -1
    reach       (ng, 1 + nq)      ks times half gap: the torque at which the contact closes
    gap_rows    (ng, 2)           bodies that the shaft torque acts on
    gap_gain    (ng, 2, 1 + nq)   by which factor: -1/ratio and 1
    slip_rows   (nf,)             bodies with Coulomb friction
    level       (nf, 1 + nq)      Coulomb torque of that body
    loss_of     (nf,)             transmission whose loss adds to that friction, or -1
    loss_gap    (nt,)             gap in that transmission, or -1
    transmitted (nt, nz, 1 + nq)  Q of the torque that it transmits to the body at rest, without a gap's contact
    loss        (nt, 2, 1 + nq)   share of it that is friction where it drives the body, where it is driven
    rotor_share (nt, 1 + nq)      share of the mass that lies in front of the transmission
    outputs     (ny, nx, 1 + nq)  y = C x
    output_gap  (ny,)             gap whose torque adds to the output, or -1
    output_state  (ny,)           state that the output equals, or -1 if it is a combination
    part_lengths  (parts,)        lengths of the parts of a sample [s]
    parts_before_switch  ()       parts before the dead time switches the torque inside a sample
    dead_time_gradient  (nq,)     d(dead time)/d(parameter)
    memory      (nx,)             factor on a state from sample to sample
    """

    rows: Float3
    mass: Float2
    spring: Float3
    open_guard: Float3
    relaxing: Int2
    reach: Float2
    gap_rows: Int2
    gap_gain: Float3
    slip_rows: Int1
    level: Float2
    loss_of: Int1
    loss_gap: Int1
    transmitted: Float3
    loss: Float3
    rotor_share: Float2
    outputs: Float3
    output_gap: Int1
    output_state: Int1
    part_lengths: Float1
    parts_before_switch: int
    dead_time_gradient: Float1
    memory: Float1
    nx: int
    nu: int
    nq: int
    ng: int
    nf: int
    nt: int
    ny: int
    ns: int
    plain: int

    @property
    def elements(self) -> int:
        """Number of switching elements, each with a digit in a mode."""
        return self.ng + self.nf + self.nt


class Laws(NamedTuple):
    """The smooth nonlinear torques of a system; nl laws.

    The torque of a law over a stretch is a parabola in time, carried by three states at the end of the state. So
    a stretch is linear and the exact kernel applies. With `a_matrix` these states are value, slope and curvature.
    Over a whole part of a sample they are the torques at its start, middle and end; the columns of phi, phi_mid
    and guard_rows are over these.

    code            (nl,)                    which law of LAW_TORQUES
    arguments       (nl, 2, nx, 1 + nq)      its two arguments over the state
    parameters      (nl, np, 1 + nq)         np: the most that one of them has
    gap             (nl,)                    gap whose contact it belongs to, or -1
    half_gap        (nl, 1 + nq)             half gap subtracted from the first argument in contact
    arguments_vary  (nl,)                    whether its arguments depend on a free parameter
    friction        (nl,)                    friction in whose slip it acts, or -1
    first           ()                       first of the 3 nl states
    in_output       ()                       whether an output contains the torque of a law

    Scratch: torque_jets (3, nl, 3 + np) torques and derivatives at start, middle and end;
    newton_matrix, matrix_scratch (2 nl, 2 nl) and torque_change (2 nl, 1), torque_columns (2 nl, ns), the equations
    of the torques at middle and end and of their sensitivities; slopes, start_slopes, middle_slopes (nl, nx);
    end_columns (first, ns); nodes (3, nx, ns + 2 nl) and term (2, nx, ns + 2 nl)

    torque, motion, columns, transition, covariance_step, premultiply, event_step, write_law_torques    addresses of
    the units law_torque, law_motion, law_columns, law_transition, covariance_step, premultiply,
    step_through_law_events and write_law_torques
    """

    code: Int1
    arguments: Float4
    parameters: Float3
    gap: Int1
    half_gap: Float2
    arguments_vary: Int1
    friction: Int1
    first: int
    in_output: bool
    torque_jets: Float3
    newton_matrix: Float2
    matrix_scratch: Float2
    torque_change: Float2
    torque_columns: Float2
    slopes: Float2
    start_slopes: Float2
    middle_slopes: Float2
    end_columns: Float2
    nodes: Float3
    term: Float3
    torque: int
    motion: int
    columns: int
    transition: int
    covariance_step: int
    premultiply: int
    event_step: int
    write_law_torques: int


class Cache(NamedTuple):
    """Matrices of the modes met so far; emptied when full.

    slot           (modes * parts + 1,)     index of a mode in the arrays, -1 if absent; last: how many there are
    a_matrix       (cap, nx, nz, 1 + nq)    dx/dt = a_matrix z
    phi            (cap, nx, nz)            x after the part of a sample = phi z
    dphi           (cap, nx, nz, nq)        its derivative
    dphi_blocks    (cap, chunks, WIDE_BLOCK nx nz)  dphi in blocks of WIDE_BLOCK columns, all rows
                   of a block in sequence
    net_torque     (cap, nf + nt, nz)       torque on a body without its Coulomb friction; then torques transmitted
    guard_rows     (cap, elements, MAX_GUARD_INSTANTS + 1, nz)  guard value at the start of the part and at instants
                   inside, over z at its start
    phi_mid        (cap, nx, nz)            x in the middle of the part, dphi_mid its derivative, dphi_mid_blocks
                   that in blocks: with laws only
    holding_torque (nf + nt, 1)             torque up to which friction holds a body at rest; then zeros
    guard_instants (cap,)                   how many instants inside there are
    rate           (cap,)                   balanced norm of a_matrix [1/s]

    The last slot is not for a mode but for a step of any length.

    The rest is scratch, for the kernel allocates nothing:
    jets (3, nx, nz, 1 + nq), square (nx, nx), transition (nx, plain and a few more), columns (3, nx, ns),
    series (SERIES_ORDER + 1, nx), poly (SERIES_ORDER + 1,), vectors (5, nx), row_scratch (3, nz),
    guards (ng + nf,), gradient (ns,)

    compute_mode, event_step, dead_time_switch    addresses of units compute_mode, step_through_events and, if the
                                                  dead time is free, switch_late; 0 where it is not needed
    """

    slot: Int1
    a_matrix: Float4
    phi: Float3
    dphi: Float4
    dphi_blocks: Float3
    net_torque: Float3
    guard_rows: Float4
    guard_instants: Int1
    rate: Float1
    phi_mid: Float3
    dphi_mid: Float4
    dphi_mid_blocks: Float3
    holding_torque: Float2
    jets: Float4
    square: Float2
    transition: Float2
    columns: Float3
    series: Float2
    poly: Float1
    vectors: Float2
    row_scratch: Float2
    guards: Float1
    gradient: Float1
    compute_mode: int
    event_step: int
    dead_time_switch: int


class SimulationBuffers(NamedTuple):
    """Samples of a record to be simulated, and arrays for the results; the next call may continue from them.

    u, late  (n, nu)         inputs, and those before the dead time switches them inside the sample
    y        (n, ny)         measured outputs, NaN where there is none
    gain     (n, ny, nx)     observer gains, or (0, ny, nx) for a free run
    weight   (n, ny)         1/std of the innovations relative to the sensor's, or (0, ny)
    x, sens  (nx,), (nx, ns) state and sensitivities, updated in place
    mode     (elements,)     updated in place; determined from the state first if `fresh`
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
    sens: Float2
    mode: Int1
    fresh: int
    out: Float2
    jac: Float3
    states: Float2


class FilterBuffers(NamedTuple):
    """A record to be filtered, and arrays for the results.

    u, late, y  as in a Pass
    r        (ny,)        sensor variances relative to that of the first output
    added_variance (nx,)  variance added to each state per sample
    noise_input (nx,)     change of each state by a unit torque noise, after its sample
    p        (plain, plain) covariance of the start state, changed
    x, mode  (nx,), (elements,) changed
    gain     (n, ny, nx)  or (0, ny, nx); entries of the states after the plain ones are not written
    var      (n, ny); innov (n, ny), NaN where unmeasured
    states   (n, nx)      filtered states, or (0, nx)
    """

    u: Float2
    late: Float2
    y: Float2
    r: Float1
    added_variance: Float1
    noise_input: Float1
    p: Float2
    x: Float1
    mode: Int1
    gain: Float3
    var: Float2
    innov: Float2
    states: Float2


class ModalSums(NamedTuple):
    """Signals that are sums of modes, and arrays for the results; complex numbers are pairs of floats.

    rates, weights     (m, n, 2)  signal i is the real part of sum weights exp(rates t)
    slopes, integrals  (m, n, 2)  weights times rates, and over rates: of the derivative and an integral
    count    (m,)          a signal's first so many modes are used
    step     (2, n, 2)     working storage
    extrema  (2, extrema)  times and values of the last signal's extrema, filled from the front
    found    (m, 2)        integral of |signal| from 0 to infinity, and the largest |integral up to t|
    """

    rates: Float3
    weights: Float3
    slopes: Float3
    integrals: Float3
    count: Int1
    step: Float3
    extrema: Float2
    found: Float2


def empty_cache(s: System, laws: Laws | None, addresses: tuple[int, int, int]) -> Cache:
    """An empty cache for the modes of a system; addresses of its units."""
    nx, nz, jet = s.rows.shape
    elements = s.elements
    modes = 3 ** elements * s.part_lengths.size
    cap = min(modes, MAX_CACHED_MODES) + 1
    half = 0 if laws is None else cap
    slot = np.full(modes + 1, -1, np.int64)
    slot[-1] = 0
    return Cache(slot, np.zeros((cap, nx, nz, jet)), np.zeros((cap, nx, nz)),
                 np.zeros((cap, nx, nz, jet - 1)),
                 np.zeros((cap, -(-(jet - 1) // WIDE_BLOCK), WIDE_BLOCK * nx * nz)),
                 np.zeros((cap, s.nf + s.nt, nz)),
                 np.zeros((cap, elements, MAX_GUARD_INSTANTS + 1, nz)), np.zeros(cap, np.int64), np.zeros(cap),
                 np.zeros((half, nx, nz)), np.zeros((half, nx, nz, jet - 1)),
                 np.zeros((half, -(-(jet - 1) // WIDE_BLOCK), WIDE_BLOCK * nx * nz)),
                 np.vstack([s.level[:, :1], np.zeros((s.nt, 1))]),
                 np.zeros((3, nx, nz, jet)), np.zeros((nx, nx)),
                 np.zeros((nx, -(-s.plain // NARROW_BLOCK) * NARROW_BLOCK)),
                 np.zeros((3, nx, s.ns)),
                 np.zeros((SERIES_ORDER + 1, nx)), np.zeros(SERIES_ORDER + 1), np.zeros((5, nx)),
                 np.zeros((3, nz)), np.zeros(s.ng + s.nf), np.zeros(s.ns), *addresses)
