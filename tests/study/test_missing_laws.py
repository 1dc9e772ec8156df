"""The study's own parts: the simulator against closed forms, sizes of the laws, the regression, the figures."""

from dataclasses import replace

import numpy as np
import pyarrow.parquet as pq
import pytest
from scipy.special import ellipk

from tests.study.missing_laws import kernel
from tests.study.missing_laws.estimators import NAMES, fit, start_values
from tests.study.missing_laws.laws import LAWS, MOST, SIZES, Law
from tests.study.missing_laws.machine import Machine
from tests.study.missing_laws.record import RIGHT, arrange, draw, missing_torque, parts_of, simulate
from tests.study.missing_laws.regression import least_squares
from tests.study.missing_laws.runner import LAYOUT, run
from tests.study.missing_laws.scores import Score, coverage, half_widths, score
from tests.study.missing_laws.tables import summary
from tests.study.shared.command import read, write
from tests.study.shared.figures import quantile, ratio, share
from tests.study.shared.rows import rows

FREE = Machine(1.0, 100.0, 0.02, 0.0, 0.0, 0.0)


def states(machine, law, torque, step=1e-3, n=1000, parts=4, **start):
    """(n + 1, STATES) under a constant torque [N m]; start: entries of the state by name."""
    first, rest = np.zeros(kernel.STATES), np.zeros(n)
    for name, value in start.items():
        first[getattr(kernel, name)] = value
    controller = np.array([1e9, 0.0, 0.0, 0.0, 0.0, 1e9])  # without a limit of the speed
    return kernel.run(step, parts, first, kernel.OPEN, rest + torque, rest, rest, controller, law.code,
                      machine.numbers(), law.numbers(machine), rest, rest, 0.0, False)[2]


def test_a_free_coast_stops_where_dry_friction_ends_it():
    found = states(replace(FREE, coulomb=0.05), Law("none"), 0.0, V=1.0337)  # stops within a sample
    assert found[-1, kernel.V] == 0.0
    assert found[-1, kernel.Q] == pytest.approx(0.02 * 1.0337**2 / (2 * 0.05), rel=1e-12)
    assert np.flatnonzero(found[:, kernel.V] == 0.0)[0] == np.ceil(0.02 * 1.0337 / 0.05 / 1e-3)


def test_a_constant_torque_approaches_its_speed():
    found = states(replace(FREE, viscous=0.01, coulomb=0.05, idle=0.02), Law("none"), 0.3)
    assert found[1000, kernel.V] == pytest.approx((0.3 - 0.07) / 0.01 * (1 - np.exp(-0.01 / 0.02)), rel=1e-10)


def test_a_pendulum_has_its_period():
    law = Law("gravity", 0.5, {"phase": -np.pi / 2})  # hangs at angle 0
    period = 4.0 * np.sqrt(0.02 / 0.5) * ellipk(np.sin(0.5 * 1.2) ** 2)
    found = states(FREE, law, 0.0, period / 400, 400, 8, Q=1.2)
    assert found[400, kernel.Q] == pytest.approx(1.2, abs=1e-9)
    assert found[100, kernel.Q] == pytest.approx(0.0, abs=1e-6)


def test_a_crank_keeps_its_energy():
    law = Law("crank", 0.4, {"phase": 0.7})
    found = states(FREE, law, 0.0, 1e-3, 500, 8, V=30.0)
    inertia = 0.02 * (1 + 0.4 * np.cos(2 * found[:, kernel.Q] + 0.7))
    assert np.ptp(found[:, kernel.V]) > 5.0
    assert inertia * found[:, kernel.V]**2 == pytest.approx(inertia[0] * 900.0, rel=1e-7)


def test_contact_behind_a_gap_conserves_momentum_and_energy():
    constants = {"frequency": 50.0, "damping": 0.0, "loss": 0.0, "half_gap": 0.01}
    found = states(FREE, Law("backlash", 0.3, constants), 0.0, 1e-4, 200, 8, V=2.0)
    first, second = found[:, kernel.V], found[:, kernel.V2]
    assert 0.7 * first + 0.3 * second == pytest.approx(0.7 * 2.0, rel=1e-12)
    assert first[49] == 2.0 and second[49] == 0.0  # half the gap takes 5 ms
    assert (first[-1], second[-1]) == pytest.approx((2.0 * 0.4, 2.0 * 1.4), rel=1e-6)  # elastic impact
    lossy = states(FREE, Law("backlash", 0.3, constants | {"loss": 0.2}), 0.0, 1e-4, 200, 8, V=2.0)
    assert 0.0 < lossy[-1, kernel.V2] - lossy[-1, kernel.V] < 1.9


def test_a_shaft_rings_at_its_frequency():
    law = Law("elastic-shaft", 0.4, {"frequency": 20.0, "damping": 0.0})
    found = states(FREE, law, 0.0, 1e-3, 50, 8, V=1.0)
    assert found[50, kernel.V] == pytest.approx(1.0, abs=1e-6)  # one period
    assert found[25, kernel.V] == pytest.approx(1.0 - 2 * 0.4, abs=1e-6)


@pytest.mark.parametrize("shape", [0.0, 1.0, 2.0])
def test_lugre_slides_on_the_stribeck_curve_and_holds_below_it(shape):
    machine = replace(FREE, viscous=0.05, coulomb=0.05)
    law = Law("lugre", 0.1, {"speed": 4.0, "shape": shape, "presliding": 0.02, "damping": 0.5})
    speed = states(machine, law, 0.4, 1e-3, 10000, 8)[-1, kernel.V]
    assert machine.viscous * speed + 0.05 + 0.1 * kernel.falling(speed / 4.0, shape) == pytest.approx(0.4, rel=1e-8)
    held = states(machine, law, 0.12, 1e-3, 2000, 8)  # breaks away at 0.15
    assert 0.0 < held[-1, kernel.Q] < 0.05
    assert held[-1, kernel.V] == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize("law", LAWS)
def test_a_law_of_size_zero_is_the_plain_machine(law):
    setup, none, _ = arrange(law, 0.0, 3, 40, 3.0)
    setup = replace(setup, quantum=0.0)  # in a loop the steps of a sensor turn the last digit into a bit of noise
    with_law, without = simulate(setup, none), simulate(setup, Law("none"))
    scale = np.abs(without.states).max(axis=0) + 1e-300
    assert np.abs((with_law.states - without.states)[:, :2] / scale[:2]).max() < 1e-9
    assert np.abs(with_law.torque - without.torque).max() < 1e-9 * setup.machine.rated_torque
    assert np.abs(with_law.measured - without.measured).max() < 1e-9 * np.abs(without.measured).max()


def sized(law, size):
    """(set-up, what was arranged, the size it states, the missing torque over the rated one) of a law of a size."""
    setup, found, stated = arrange(law, SIZES[size], 7, 6, 4.0)
    return setup, found, stated, missing_torque(setup, found, simulate(setup, found)) / setup.machine.rated_torque


def with_sizes(laws):
    """Two of three sizes for each law, so that all occur."""
    return pytest.mark.parametrize(("law", "size"), [
        (law, size) for i, law in enumerate(LAWS) for size in ("SM", "ML", "SL")[i % 3] if law in laws])


@with_sizes(MOST)
def test_a_size_is_the_rms_share_of_rated_torque(law, size):
    _, found, stated, missing = sized(law, size)
    assert np.sqrt(np.mean(missing**2)) == pytest.approx(stated, rel=1e-9)
    # Contacts are chaotic; the ripple of a sensor and the mass behind a shaft have a largest value.
    assert stated == pytest.approx(SIZES[size], rel=0.1) or found.strength > 0.95 * MOST[law]


@with_sizes({"log-noise"})
def test_the_size_of_noise_is_its_standard_deviation(law, size):
    assert np.std(sized(law, size)[3]) == pytest.approx(SIZES[size], rel=0.05)


@with_sizes({"lugre"})
def test_the_size_of_bristles_is_what_they_add_to_the_breakaway_torque(law, size):
    setup, found, _, _ = sized(law, size)
    slow = found.curves(setup.machine, np.array([0.0]), np.zeros(1))[0][0] - setup.machine.coulomb
    assert slow / setup.machine.rated_torque == pytest.approx(SIZES[size], rel=1e-12)


@with_sizes(set(LAWS) - set(MOST) - {"log-noise", "lugre"})
def test_a_size_is_the_largest_share_of_rated_torque(law, size):
    assert SIZES[size] * 0.8 < np.quantile(np.abs(sized(law, size)[3]), 0.999) < SIZES[size] * 1.001


@pytest.mark.parametrize("law", ("none", *LAWS))
def test_the_integrators_error_is_that_of_less_than_a_ten_thousandth_of_the_inertia(law):
    setup, found, _ = arrange(law, SIZES["L"], 4, 60, 3.0)
    before, p, a = simulate(setup, found), setup.machine.numbers(), found.numbers(setup.machine)
    net = before.torque - setup.log_noise
    net = (np.clip(net, -a[0], a[0]) if law == "saturation" else net) + setup.disturbance - setup.load
    parts, end, work = parts_of(setup, found), np.zeros(kernel.STATES), np.zeros((5, kernel.STATES))
    changes = []
    for i in range(0, len(net), 10):  # every tenth sample, from the same state, so that no chaos counts
        speeds = []
        for each in (parts, 2 * parts):
            y = before.states[i].copy()
            kernel.over_sample(y, end, work, i * setup.step, setup.step, each, net[i], found.code, p, a)
            speeds.append(y[kernel.V] - before.states[i, kernel.V])
        changes.append(speeds)
    coarse, fine = np.array(changes).T
    assert abs((coarse - fine) @ fine) / (fine @ fine) < 1e-5
    assert np.linalg.norm(coarse - fine) < 1e-4 * np.linalg.norm(fine)


def test_records_are_varied_and_half_of_them_are_in_closed_loop():
    drawn = [draw(right, "", number, 500 + number) for number in range(8) for right in RIGHT[:2]]
    assert sum(record.closed for record in drawn) == len(drawn) // 2
    assert len({record.excitation for record in drawn}) == 8
    assert {record.role for record in drawn} == {"motor_speed", "motor_angle"}
    rated = [record.truth.rated for record in drawn]
    assert max(rated) > 100 * min(rated)
    for record in drawn:
        assert record.step * (len(record.torque) + 1) >= 6.0 and record.step * len(record.torque) <= 15.0
        assert record.truth.curve == pytest.approx(record.machine.coulomb
                                                   + record.machine.viscous * record.truth.speeds)
        assert record.truth.line == pytest.approx((record.machine.viscous, record.machine.coulomb), rel=1e-6)


def test_the_truth_of_a_law_is_the_mean_of_both_directions():
    record = draw("asymmetry", "L", 1, 70)
    extra = record.truth.curve - record.machine.coulomb - record.machine.viscous * record.truth.speeds
    assert np.all(extra > 0.0)
    assert abs(record.truth.idle - record.machine.idle) == pytest.approx(np.mean(extra), rel=1e-9)
    assert draw("crank", "L", 1, 70).truth.inertia == draw("gravity", "S", 1, 70).truth.inertia
    curved = draw("stribeck", "L", 1, 70).truth
    left = curved.curve - np.polyval(curved.line, curved.speeds)
    assert np.ptp(left) > 0.01 * np.mean(curved.curve)
    assert [np.mean(left), np.mean(left * curved.speeds) / curved.speeds[-1]] == pytest.approx(
        [0.0, 0.0], abs=1e-9 * np.mean(curved.curve))


@pytest.mark.parametrize("number", [0, 2, 3, 7, 13, 14])
def test_the_regression_regains_a_right_model(number):
    record = draw("noise-free", "", number, 100 + number)
    found = least_squares(record.step, record.torque, record.measured, record.role == "motor_angle").value
    truth = record.truth
    assert found[0] == pytest.approx(truth.inertia, rel=1e-3)
    assert found[1] * truth.speeds + found[2] == pytest.approx(truth.curve, rel=1e-3)


def test_the_command_line_regains_a_right_model_and_says_how_well(tmp_path):
    record = draw("noise-free", "", 1, 104)
    start = start_values(record, 1)
    off = np.array([start[name] for name in NAMES]) / record.machine.numbers() - 1.0
    assert np.all((np.abs(off) >= 0.15) & (np.abs(off) <= 0.5))
    found = fit(record, 1, "simulation")
    assert found["value"] == pytest.approx(record.machine.numbers().tolist(), rel=1e-5)
    assert found["status"] == ["fitted"] * 4 and found["seconds"] > 0.0
    assert all(low <= value <= high for value, (low, high) in zip(found["value"], found["ci95"], strict=True))
    write(record.step, {"motor_torque": record.torque}, tmp_path / "a.parquet")
    schema = pq.read_schema(tmp_path / "a.parquet")
    assert schema.field("motor_torque").metadata == {b"unit": b"Nm"}
    assert "criterion" in fit(record, 1, "no-such-criterion")["failed"]


def test_a_parameter_without_interval_is_read_as_one():
    lines = {name: {"value": 1.0, "std": 0.1, "ci95": [0.8, 1.2], "status": "fitted"} for name in NAMES}
    lines["motor.coulomb"] = {"value": 0.0, "status": "at boundary", "std": None, "ci95": None}
    names = [name for name in NAMES if name != "motor.coulomb"]
    covariance = {"names": names, "matrix": np.diag([4.0, 1.0, 9.0]).tolist()}
    found = read({"parameters": lines, "covariance": covariance}, NAMES)
    assert found["correlation"][0] == [1.0, 0.0, None, 0.0]
    half, friction = half_widths(found, np.array([1.0, 2.0, 3.0]))
    assert half == pytest.approx(0.2) and np.all(np.isnan(friction))


# Figures


def made_up(error=0.0, half=0.02, link=0.0, seconds=1.0):
    """A row whose estimates are all `error` off, with intervals of half-width `half`, in shares of the truth."""
    true = np.array([2.0, 0.1, 1.0, 0.5])
    value = true * (1.0 + error)
    return {"truth": {"inertia": 2.0, "idle": 0.5, "rated": 10.0, "speeds": [5.0, 10.0, 15.0],
                      "curve": [1.5, 2.0, 2.5], "line": [0.1, 1.0], "marks": [5.0, 10.0, 14.0]},
            "value": value.tolist(), "ci95": np.column_stack([value - half * true, value + half * true]).tolist(),
            "correlation": (np.eye(4) + link * np.eye(4)[[0, 2, 1, 3]] * (np.eye(4) == 0)).tolist(),
            "seconds": seconds}


def test_scores_of_made_up_rows():
    found = score(made_up(error=-0.05))
    assert (found.inertia, found.idle) == pytest.approx((0.05, 0.0025))
    assert found.friction == pytest.approx(0.05 * np.sqrt((1.5**2 + 2.0**2 + 2.5**2) / 3) / 2.0)
    assert found.over[0] == pytest.approx(2.5)
    assert found.over[2] == pytest.approx(0.05 * 2.0 / (0.02 * np.sqrt(2.0)))
    assert found.inertia_half == pytest.approx(0.02)
    _, friction = half_widths(made_up(link=-1.0), np.array([10.0, 20.0]))
    assert friction == pytest.approx([0.0, 0.02], abs=1e-9)
    assert np.all(score(made_up(error=1e-8, half=0.0)).over == 0.0)  # rounding is no error
    assert np.all(np.isinf(score(made_up(error=1e-3, half=0.0)).over))
    failed = score({"failed": "so", "seconds": 2.0})
    assert failed.inertia == np.inf and np.isnan(failed.over).all() and failed.seconds == 2.0


def test_shares_have_the_intervals_of_clopper_and_pearson():
    assert share(0, 10) == pytest.approx((0.0, 0.0, 1.0 - 0.005**0.1))
    assert share(10, 10) == pytest.approx((1.0, 0.005**0.1, 1.0))
    assert share(8, 10, 0.95) == pytest.approx((0.8, 0.4439045, 0.9747893), abs=1e-7)
    assert share(0, 0)[1:] == (0.0, 1.0)


def test_coverage_counts_what_holds_what_is_far_off_and_what_is_not_stated():
    over = [[0.5, 0.5, 1.5, 0.5], [1.5, 0.5, 0.5, 0.5], [0.2, 0.2, 3.5, 0.2], [np.nan] * 4]
    found = coverage(Score(0, 0, 0, np.array(each), 0, 0, 0) for each in over)
    assert found.inertia[0] == pytest.approx(2 / 3)
    assert found.friction[0] == pytest.approx(7 / 9)
    assert found.friction[1] < 7 / 9 < found.friction[2]
    assert found.far == share(1, 3)
    assert (found.n, found.without) == (3, 1)


def test_quantiles_and_ratios():
    assert quantile(np.arange(11.0), 0.9) == 9.0
    assert quantile(np.array([1.0, 2.0, np.inf]), 0.5) == 2.0
    assert quantile(np.array([1.0, np.inf]), 0.5) == np.inf
    rng = np.random.default_rng(1)
    mine = rng.lognormal(size=60)
    assert ratio(mine, mine / 2.0) == pytest.approx((2.0, 2.0, 2.0))
    noisy = ratio(mine, mine * np.exp(0.3 * rng.standard_normal(60)))
    assert noisy[1] < noisy[0] < noisy[2] and noisy[1] < 1.0 < noisy[2]
    kinds = ["a", "b"] * 30
    step = np.where(np.array(kinds) == "a", 1.0, 3.0)  # of each kind as many in every draw: no spread at all
    assert ratio(step, np.ones(60), 0.25, kinds) == (1.0, 1.0, 1.0)
    assert ratio(step, np.ones(60), 0.5)[1:] == (1.0, 3.0)


def test_rows_are_written_once_and_a_broken_line_again(tmp_path):
    wanted, path = LAYOUT.jobs(1, 1, ("regression",), ("M",))[-3:], tmp_path / "rows.jsonl"
    assert len(LAYOUT.jobs(2, 3, ("regression",))) == 2 * 3 * len(LAWS) + 3 * len(RIGHT)
    assert len({job.seed for job in LAYOUT.jobs(2, 3, ("regression",))}) == len(LAYOUT.jobs(2, 3, ("regression",)))
    first = run(wanted, path, 1)
    text = path.read_text()
    assert run(wanted, path, 1) == first and path.read_text() == text
    path.write_text(text[:-40])
    assert [row["value"] for row in run(wanted, path, 1)] == [row["value"] for row in first]
    assert len(rows(path)) == 3
    more = [replace(job, estimators=("regression", "other")) for job in wanted[:1]]
    assert more[0].key("regression") == first[0]["key"]
    table = summary([*first, *(row | {"estimator": "other", "key": row["key"].replace("regression", "other")}
                               for row in first)], "regression")
    assert "3 records with all of regression, other" in table
    assert "heavy other" in table and summary([]) == "no rows"


def test_a_table_says_who_errs_by_how_much_more():
    found = [made_up(error, half=0.02) | {"key": f"crank/M/{i}/1/{name}", "law": "crank", "size": "M", "seed": i,
                                          "estimator": name}
             for i in range(10) for name, error in (("auto", 0.03), ("simulation", 0.01), ("regression", 0.05))]
    for row in found:
        row["truth"]["share"] = 0.05
    table = summary(found, "simulation")


    def cells(title, name):
        part = next(part for part in table.split("\n\n") if part.startswith(title))
        return next(line for line in part.splitlines() if line.startswith(f"{name}  ")).removeprefix(name).split()

    assert " ".join(cells("error of the inertia", "M")) == "3.00 / 3.00 1.00 / 1.00 5.00 / 5.00 10"
    assert cells("error over that of simulation", "M auto") == ["3.00", "(3.00-3.00)"] * 4 + ["10"]
    assert cells("95 %", "M simulation")[:4] == ["100", "(59-100)", "100", "(59-100)"]
    assert cells("95 %", "M regression")[:2] == ["0", "(0-41)"]
    assert cells("laws whose", "M auto") == ["0", "0", "crank", "crank", "1"]
    assert cells("share of rated", "crank") == ["nan", "5.0", "nan", "10"]
