"""A logger that changes its rate: each rate has a grid of its own, and nothing else is taken for that."""

import numpy as np
import pytest

from drivetool.errors import NotEnoughData
from drivetool.logs.clocks.rate_changes import find_rates
from drivetool.logs.conditioning.steps import condition, parse_step
from drivetool.logs.door.build import build_experiment
from drivetool.logs.experiment import Channel, Recording, parts_at_all_rates, recording_sources, refuse_copies

STEP = 1e-3


def stamps(*stretches, start=0.0):
    """(samples, step) one after the other."""
    steps = np.concatenate([np.full(n, step) for n, step in stretches])
    return start + np.concatenate([[0.0], np.cumsum(steps)[:-1]])


def sine(time, f=1.3):
    return np.sin(2.0 * np.pi * f * time)


def recording(time, torque=None, **more):
    """Motor torque and speed on one clock; more: role -> (time, values)."""
    channels = {"motor_torque": Channel(time, sine(time) if torque is None else torque, "Nm"),
                "motor_speed": Channel(time, 10.0 * sine(time, 0.7), "rad/s")}
    units = {"torque": "Nm", "speed": "rad/s"}
    channels |= {role: Channel(t, v, units[role.rpartition("_")[2]]) for role, (t, v) in more.items()}
    return Recording("log.parquet", "0" * 64, channels)


def codes(experiment):
    return [f.code for f in experiment.findings]


def test_two_rates_are_two_grids_and_every_sample_is_as_it_was():
    time = stamps((2000, STEP), (1000, 4 * STEP))
    made = recording(time)
    found = build_experiment(made)
    fast, slow = parts_at_all_rates([found])
    assert codes(found) == ["rate-changes"] and found.findings[0].severity == "note"
    assert (fast.step, slow.step) == pytest.approx((STEP, 4 * STEP))
    assert fast.segments == ((0, 2000),) and slow.segments == ((0, 1000),)
    assert (fast.begins, slow.begins) == (True, False) and slow.offset == pytest.approx(2.0)
    for part, own in ((fast, slice(0, 2000)), (slow, slice(2000, 3000))):
        np.testing.assert_allclose(part.time, time[own], atol=1e-9)
        for role, channel in made.channels.items():
            np.testing.assert_array_equal(part.signals[role], channel.values[own])
    assert recording_sources([fast, slow]) == (found.source,) == recording_sources([found])
    refuse_copies([found])


def test_a_rate_that_comes_back_is_one_grid_with_a_pause_that_is_no_gap():
    found = build_experiment(recording(stamps((2000, STEP), (500, 4 * STEP), (1500, STEP))))
    fast, slow = parts_at_all_rates([found])
    assert fast.segments == ((0, 2000), (4000, 5500)) and slow.segments == ((0, 500),)
    assert codes(found) == ["rate-changes"]


def test_a_gap_inside_a_part_is_one():
    time = stamps((2000, STEP), (600, 4 * STEP), (1, 0.4), (400, 4 * STEP))
    found = build_experiment(recording(time))
    _, slow = parts_at_all_rates([found])
    assert len(slow.segments) == 2 and slow.used == 1001
    gap = next(f for f in found.findings if f.code == "recording-interrupted")
    assert gap.evidence["gaps"] == 1 and "4 ms" not in gap.text and "250 Hz" in gap.text


def test_a_short_visit_to_a_fast_rate_ends_a_stretch_of_the_slow_one():
    """Sixty fast samples pass in less than two slow steps: no gap to the slow clock, and still not its own."""
    found = build_experiment(recording(stamps((200, 33 * STEP), (60, STEP), (200, 33 * STEP))))
    slow = next(e for e in parts_at_all_rates([found]) if e.step > 0.01)
    assert len(slow.segments) == 2 and slow.used == 400


def lossy(rng):
    """Losses of every size, of half of the samples for a while."""
    keep = rng.random(6000) > np.where((np.arange(6000) > 2000) & (np.arange(6000) < 4000), 0.5, 0.02)
    return (np.arange(6000) * STEP)[keep]


def overloaded(rng):
    """Nine of ten samples are lost for a while: that is no rate."""
    keep = rng.random(9000) > np.where(np.arange(9000) > 3000, 0.9, 0.0)
    return (np.arange(9000) * STEP)[keep]


def bursts(rng):
    return (np.arange(40)[:, None] * 0.5 + np.arange(100) * STEP).ravel()


def small_batches(rng):
    return (np.arange(600)[:, None] * 10 * STEP + np.arange(2) * STEP).ravel()


WITHOUT_RATE_CHANGE = {
    "one rate": lambda rng: np.arange(4000) * STEP,
    "single losses": lambda rng: np.delete(np.arange(4000), rng.integers(1, 3999, 300)) * STEP,
    "losses in a while": lossy,
    "overload": overloaded,
    "jitter": lambda rng: (np.arange(4000) + rng.uniform(-0.4, 0.4, 4000)) * STEP,
    "at random": lambda rng: np.cumsum(rng.exponential(STEP, 4000)),
    "at random, then seldom": lambda rng: np.cumsum(np.repeat([1, 10], 2000) * rng.exponential(STEP, 4000)),
    "bursts with pauses": bursts,
    "batches of two": small_batches,
    "two steps in turn": lambda rng: np.cumsum(np.where(rng.random(4000) < 0.5, STEP, 1.4 * STEP)),
    "drift": lambda rng: np.cumsum(np.linspace(STEP, 1.6 * STEP, 6000)),
    "another rate for a moment": lambda rng: stamps((2000, STEP), (40, 4 * STEP), (2000, STEP)),
}


@pytest.mark.parametrize("kind", WITHOUT_RATE_CHANGE)
@pytest.mark.parametrize("seed", range(5))
def test_what_is_no_change_of_the_rate(kind, seed):
    assert find_rates(WITHOUT_RATE_CHANGE[kind](np.random.default_rng(seed))) == []


@pytest.mark.parametrize(("samples", "ratio", "found"), [
    (60, 4.0, 2), (40, 4.0, 0),  # a rate lasts for fifty samples: half or twice that would fail
    (500, 1.4, 2), (500, 1.15, 0)])  # from a quarter on it is another one
def test_how_long_and_by_how_much_a_rate_differs(samples, ratio, found):
    one, other = (1000, STEP), (samples, ratio * STEP)
    for time in (stamps(one, other, one), stamps(one, other), stamps(other, one),
                 stamps((1000, ratio * STEP), (samples, STEP))):
        assert len(find_rates(time)) == found


@pytest.mark.parametrize(("lost", "found"), [(0.1, 2), (0.3, 0)])
def test_a_rate_is_kept_by_four_of_five_steps(lost, found):
    """Of the steps of a clock that loses a share p of its samples at random, 1 - p are single ones."""
    for seed in range(5):
        keep = np.random.default_rng(seed).random(3000) > lost
        time = np.concatenate([np.arange(3000)[keep] * STEP, 3.0 + np.arange(1000) * 8 * STEP])
        assert len(find_rates(time)) == found


def test_clocks_of_their_own_change_together():
    """The torque 0.3 ms before the speed, at both rates."""
    time = stamps((2000, STEP), (1000, 4 * STEP), start=1.0)
    early = time - 3e-4
    found = build_experiment(recording(time, motor_torque=(early, sine(early))))
    fast, slow = parts_at_all_rates([found])
    assert (fast.step, slow.step) == pytest.approx((STEP, 4 * STEP))
    assert fast.used >= 1998 and slow.used >= 998
    for part in (fast, slow):
        first, last = part.segments[0]
        at = 1.0 + part.time[first:last]
        # The mean of a held torque over a step: what it is in the middle, but for half a step of its slope.
        assert np.abs(part.signals["motor_torque"][first:last] - sine(at)).max() < 2.0 * np.pi * 1.3 * part.step


def test_a_fast_torque_beside_a_slower_speed_changes_nothing():
    """What the torque's clock carries through is one grid, as before; the speed has fewer values there."""
    time = np.arange(8000) * STEP
    there = (np.arange(8000) < 4000) | (np.arange(8000) % 4 == 0)
    speed = sine(time, 0.7)[there]
    found = build_experiment(recording(time, motor_speed=(time[there], speed)))
    assert found.others == () and found.segments == ((0, 7997),)  # to the last speed
    assert np.isfinite(found.signals["motor_speed"]).sum() == len(speed)


def test_the_rate_with_most_excitation_leads():
    time = stamps((4000, STEP), (1000, 4 * STEP))
    found = build_experiment(recording(time, torque=np.where(time < 4.0, 0.1, 1.0) * sine(time)))
    assert found.step == pytest.approx(4 * STEP) and found.others[0].used == 4000 and not found.begins


def test_a_part_that_cannot_be_used_is_left_out_with_its_reason():
    time = stamps((2000, STEP), (200, 4 * STEP))
    still = recording(time)
    values = {role: np.where(np.arange(2200) < 2000, c.values, 0.0) for role, c in still.channels.items()}
    found = build_experiment(Recording("log.parquet", "0" * 64, {
        role: Channel(time, values[role], c.unit) for role, c in still.channels.items()}))
    finding = next(f for f in found.findings if f.code == "rate-changes")
    assert found.others == () and finding.severity == "warning" and "250 Hz" in finding.text \
        and "constant" in finding.text


def test_a_record_without_any_part_that_can_be_used_is_refused():
    time = stamps((2000, STEP), (200, 4 * STEP))
    with pytest.raises(NotEnoughData, match="a torque or a motion that changes"):
        build_experiment(Recording("log.parquet", "0" * 64, {
            "motor_torque": Channel(time, np.zeros(2200), "Nm"),
            "motor_speed": Channel(time, np.ones(2200), "rad/s")}))


def test_parts_of_the_recording_and_conditioning_act_on_every_rate():
    time = stamps((4000, STEP), (1000, 4 * STEP))
    steps = [parse_step("keep from=1"), parse_step("omit from=5 to=6"), parse_step("decimate factor=2")]
    found = condition(build_experiment(recording(time), None, steps), steps)
    fast, slow = parts_at_all_rates([found])
    assert (fast.step, slow.step) == pytest.approx((2 * STEP, 8 * STEP))
    assert fast.used == 1500 and fast.time[0] == pytest.approx(1.0)
    assert [tuple(slow.time[[a, b - 1]].round(3)) for a, b in slow.segments] == [
        pytest.approx((4.0, 4.992)), pytest.approx((6.0, 7.992))]
    # Known speeds behind what was left out are missing nowhere else.
    for part in (fast, slow):
        assert all(np.isfinite(part.signals["motor_speed"][a:b]).all() for a, b in part.segments)
