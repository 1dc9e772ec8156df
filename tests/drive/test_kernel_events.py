"""The kernel against the event-accurate simulator: gaps, friction, both, and difficult cases."""

import numpy as np
import pytest

from drivetool.drive.simulation.simulate import Trace
from tests.drive.test_kernel import (
    CHAIN,
    STEP,
    THREE,
    changed,
    compared,
    drive_of,
    kernel,
    levels,
    plant_of,
    rms,
    start_of,
)
from tests.simulator.machine import Machine, State, machine_by_seed

GAP_ERROR_BOUND, FRICTION_ERROR_BOUND = 1e-7, 1e-4  # rad/s rms, required accuracy
USUAL_ERROR_BOUND = 3e-9  # reached on records that do not amplify the rounding errors of either side

HEAVY = Machine((0.6, 5.2), (0.3, 0.1), (), (0.0, 2.0), (3300.0,), (3.1,), (0.01,), rated_torque=200.0)
LIGHT_RIG = changed(HEAVY, inertia=(4.8, 0.65))
LAWS = ("inside", "always")


# Gaps


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("half_gap", [2e-4, 2e-3, 10e-3, 75e-3])
@pytest.mark.parametrize("machine", [HEAVY, LIGHT_RIG], ids=["heavy", "light"])
def test_gap(machine, half_gap, law):
    machine = changed(machine, half_gap=(half_gap,), law=law)
    error, events, located = compared(machine, levels(machine, 1000, 1))
    assert events["contact_lost"] >= 2 and located >= 2
    assert error < (GAP_ERROR_BOUND if half_gap > 0.05 else USUAL_ERROR_BOUND)


@pytest.mark.parametrize("law", LAWS)
def test_a_gap_of_zero_width_is_no_gap(law):
    machine = changed(HEAVY, half_gap=(0.0,), law=law)
    torque = levels(machine, 3000, 2)
    whole = kernel(machine, torque)
    plant = plant_of(drive_of(machine), ["motor_speed", "load_speed"], ["shaft.half_gap"])
    trace = Trace(torque[:, None], np.zeros((3000, 2)), STEP)
    out, _, located = plant.simulate(trace, start_of(machine, plant))
    assert plant.system.ng == 1 and located > 20
    np.testing.assert_allclose(out, whole[0], atol=1e-10)


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("half_gap", [(0.01, 0.0), (0.0, 0.004), (0.01, 0.004)])
def test_gaps_in_a_chain_of_three(half_gap, law):
    machine = changed(THREE, coulomb=(), half_gap=half_gap, law=law)
    error, events, _ = compared(machine, levels(machine, 1000, 3))
    assert events["contact_lost"] > 5 and error < USUAL_ERROR_BOUND


@pytest.mark.parametrize("law", LAWS)
def test_table_5_1(law):
    """A torque step on a motor with friction opens the gap, without friction it does not."""
    for viscous, opens in ((10.0, True), (0.0, False)):
        machine = Machine((1.0, 1.0), (viscous, 0.0), stiffness=(1e4,), half_gap=(1e-3,), law=law)
        start = State((0.0, 0.0), (1e-3,))
        error, events, _ = compared(machine, np.full(1000, 10.0), STEP, start)
        shaft = kernel(machine, np.full(1000, 10.0), STEP, start)[1]
        assert (events["contact_lost"] > 0) == opens and bool(np.any(shaft[5:] == 0.0)) == opens
        assert shaft.min() > -1e-9 and error < USUAL_ERROR_BOUND


# Coulomb friction


@pytest.mark.parametrize("coulomb", [(5.0, 0.0), (0.0, 4.0), (5.0, 4.0)], ids=["motor", "load", "both"])
@pytest.mark.parametrize("half_gap", [0.0, 0.01])
def test_friction(coulomb, half_gap):
    machine = changed(HEAVY, coulomb=coulomb, half_gap=(half_gap,), viscous=(3.0, 1.0))
    error, events, _ = compared(machine, levels(machine, 1500, 4, share=0.1))
    assert events["released"] > 2 and events["stuck"] > 1 and events["reversed"] > 2
    assert error < USUAL_ERROR_BOUND


@pytest.mark.slow
@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("seed", [0, 1])
def test_three_bodies_with_everything(seed, law):
    machine = changed(THREE, law=law, coulomb=(15.0, 9.0, 9.0), converter_bandwidth=433.0,
                      dead_time=1.4 * STEP)
    start = State((0.0,) * 3, (0.0,) * 2)
    error, events, _ = compared(machine, levels(machine, 1000, seed), STEP, start,
                                np.repeat(np.random.default_rng(seed).uniform(-9.0, 9.0, 50), 20))
    assert min(events["contact_lost"], events["stuck"], events["released"], events["reversed"]) > 0
    assert error < USUAL_ERROR_BOUND


@pytest.mark.parametrize("first", [0.0, 0.9, -0.2])
def test_one_body(first):
    machine = Machine((2.0,), (0.3,), (1.7,), (0.4,), rated_torque=20.0)
    error, events, _ = compared(machine, levels(machine, 1500, 5, share=0.5), STEP, State((first,), ()))
    assert events["stuck"] + events["reversed"] > 10
    assert error < 1e-12


def test_sticking_for_long_has_no_creep():
    machine = changed(HEAVY, coulomb=(5.0, 0.0), half_gap=(0.0,), idle_torque=())
    torque = np.concatenate([np.full(300, 20.0), np.zeros(20000)])
    speeds, shaft, angles, located = kernel(machine, torque)
    still = slice(15000, None)
    assert np.all(speeds[still, 0] == 0.0) and np.ptp(angles[still, 0]) == 0.0
    assert np.abs(shaft[still]).max() < 5.0 and located < 100


def test_breakaway_inside_a_sample_and_reversal_without_stick():
    """A ramp of shaft torque passes the level between samples; a hard reversal does not rest."""
    machine = Machine((1.0, 1.0), coulomb=(2.0, 1.0), stiffness=(500.0,), damping=(1.0,), rated_torque=4.0)
    error, events, _ = compared(machine, np.concatenate([np.linspace(0.0, 4.0, 301), np.full(200, -9.0)]))
    assert events["released"] > 1 and events["reversed"] >= 2 and error < USUAL_ERROR_BOUND


# Difficult cases


@pytest.mark.parametrize("excess", [1e-3, 5e-5, 1e-9, 1e-12, 1e-15, 0.0, -1e-15])
@pytest.mark.parametrize("side", [1, -1])
def test_release_and_capture_within_microseconds(excess, side):
    machine = Machine((0.6, 5.2), coulomb=(5.0, 0.0), stiffness=(3300.0,), damping=(3.1,))
    start = State((0.0, -5e-3 * side), (-side * (5.0 + excess + 3.1 * 5e-3) / 3300.0,))
    assert compared(machine, np.zeros(200), STEP, start)[0] < 1e-12


@pytest.mark.parametrize("step", [1e-3, 0.01, 0.02, 0.025, 0.03])
@pytest.mark.parametrize("excess", [1e-2, 1e-5, 1e-9])
def test_a_break_that_heals_between_two_looks(step, excess):
    """The shaft torque of a swinging load tops the motor's Coulomb level by a little."""
    machine = Machine((0.6, 5.2), coulomb=(5.0, 0.0), stiffness=(3300.0,))
    start = State((0.0, -5.0 * (1.0 + excess) / np.sqrt(3300.0 * 5.2)), (0.0,))
    error, events, _ = compared(machine, np.zeros(round(0.3 / step)), step, start)
    assert events["released"] >= 1 and error < 1e-11


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("phase", np.linspace(0.05, 0.95, 7))
def test_a_contact_that_opens_and_closes_between_samples(law, phase):
    """The torque changes sign every sample, the twist swings by a h^2/8 above and below the edge.

    It is the same at all samples then, so that differences of samples say nothing.
    """
    machine = Machine((1.0, 1.0), stiffness=(1e4,), damping=(0.01,), half_gap=(1e-3,), law=law)
    start = State((8.0 * STEP / 2, 0.0), (1e-3 + phase * 1e-6,))
    error, events, _ = compared(machine, np.array([-8.0, 8.0] * 5), STEP, start)
    assert events["contact_lost"] > 0 and error < 1e-12


@pytest.mark.parametrize("law", LAWS)
def test_steady_running_at_the_very_edge_of_contact(law):
    machine = Machine((0.6, 5.2), coulomb=(5.0, 0.0), stiffness=(3300.0,), damping=(3.1,),
                      half_gap=(0.01,), law=law)
    for twist in (0.01, -0.01):
        speeds, shaft, _, _ = kernel(machine, np.full(500, 5.0), STEP, State((1.0, 1.0), (twist,)))
        np.testing.assert_allclose(speeds, 1.0, atol=1e-12)
        assert np.abs(shaft).max() < 1e-10


def test_everything_at_rest_stays_at_rest():
    speeds, shaft, angles, _ = kernel(THREE, np.zeros(500), STEP, State((0.0,) * 3, (0.01, -0.003)))
    moved = kernel(changed(THREE, idle_torque=()), np.zeros(500), STEP, State((0.0,) * 3, (0.01, -0.003)))
    assert np.all(moved[0] == 0.0) and np.all(moved[1] == 0.0) and moved[3] == 0
    assert np.all(np.isfinite(speeds)) and np.all(np.isfinite(shaft)) and np.all(np.isfinite(angles))


# Sampling


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("seed", [0, 1, 6])
def test_coarse_sampling(seed, law):
    """Six samples per period of the resonance and fewer, many events in one."""
    machine = machine_by_seed(seed, gap=0.05, friction=True, law=law)
    reduced = np.prod(machine.inertia) / sum(machine.inertia)
    step = 2.0 * np.pi / 6.0 / np.sqrt(machine.stiffness[0] / reduced)
    error, events, located = compared(machine, levels(machine, 120, seed, hold=3), step)
    assert events["contact_lost"] > 5 and events.total() > located / 2
    assert error < GAP_ERROR_BOUND


@pytest.mark.slow
@pytest.mark.parametrize(("radians", "hold", "n"), [(3.0, 1, 200), (6.0, 3, 120)])
@pytest.mark.parametrize(("law", "seed"), [("inside", 0), ("inside", 2), ("inside", 5), ("inside", 7),
                                            ("always", 1), ("always", 3), ("always", 4), ("always", 6)])
def test_samples_long_against_the_poles(radians, hold, n, law, seed):
    """Half a period of the resonance in a sample, or a whole one; up to ten events in it.

    The record must not amplify rounding errors, or those of either side would be compared.
    """
    machine = machine_by_seed(seed, gap=0.02, friction=True, law=law)
    step = radians / np.sqrt(machine.stiffness[0] * sum(1.0 / j for j in machine.inertia))
    torque = levels(machine, n, seed, hold)
    error, events, located = compared(machine, torque, step)
    assert events.total() > located > n / 4 and events["contact_made"] > n / 5
    assert error < GAP_ERROR_BOUND
    speeds, fine, near = (kernel(m, np.repeat(torque, k), step / k)[0][::k] for m, k in (
        (machine, 1), (machine, 8), (changed(machine, stiffness=(machine.stiffness[0] * (1.0 + 1e-10),)), 1)))
    assert rms(near - speeds) < 1e-6 and rms(fine - speeds) < USUAL_ERROR_BOUND


@pytest.mark.parametrize("factor", [4, 16])
def test_sampling_does_not_matter(factor):
    machine = machine_by_seed(6, gap=0.02, friction=True)
    torque = levels(machine, 60, 8, hold=3)
    coarse = kernel(machine, torque, 0.02)
    fine = kernel(machine, np.repeat(torque, factor), 0.02 / factor)
    np.testing.assert_allclose(coarse[0], fine[0][::factor], atol=1e-9)
    assert coarse[3] > 30


def test_dead_time_inside_a_sample_with_events():
    machine = changed(HEAVY, coulomb=(5.0, 4.0), dead_time=2.4 * STEP, viscous=(3.0, 1.0))
    error, events, _ = compared(machine, levels(machine, 1000, 4, share=0.1), STEP, State((0.0, 0.0), (0.0,)))
    assert events["stuck"] > 0 and events["contact_lost"] > 0 and error < USUAL_ERROR_BOUND


def test_linear_chain_with_elements_that_never_act_is_the_linear_chain():
    machine = changed(CHAIN, half_gap=(1e-9, 0.0))
    torque = np.full(400, 20.0)
    start = State((0.0,) * 3, (1.0, 1.0), 0.0, 20.0)
    np.testing.assert_allclose(kernel(machine, torque, STEP, start)[0],
                               kernel(CHAIN, torque, STEP, start)[0], atol=1e-6)
