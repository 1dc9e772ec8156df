"""The gap by the dead stretches of a shaft torque, and which law its damping follows."""

from dataclasses import replace

import pytest

from drivetool.drive import two_mass
from drivetool.identify.backlash.estimator import backlash
from drivetool.identify.setup.options import Options
from drivetool.identify.setup.setup import roles_of
from drivetool.identify.setup.task import Task
from drivetool.identify.shaft_torque.dead_stretches import CONTACT_TORQUE_SHARES, crossings
from drivetool.identify.shaft_torque.gap_laws import MIN_LAW_LEAD, fit_gap_laws, gap_law_finding
from tests.light_rigs import HEAVY, TABLE
from tests.study.study_gap_laws import gap_record, truth_of
from tests.study.study_shaft_torque import ROLES, opened

# The rigs of Table 6.2 with their gaps open.
RIGS = {"light": (TABLE, 0.156), "heavy": (HEAVY, 0.131)}


def rig(name, law, damping):
    machine, half_gap = RIGS[name]
    return replace(machine, half_gap=(half_gap,), law=law, damping=(damping,))


def task_of(machine, seed=5, roles=ROLES, **values):
    record = opened(gap_record(machine, seed), "gap", roles)
    drive = two_mass().with_values(truth_of(machine) | {f"shaft.{n}": v for n, v in values.items()})
    return Task(drive, ("shaft.half_gap",), roles_of([record], drive), (record,))


@pytest.mark.parametrize("damping", [0.083, 0.863, 3.0])
@pytest.mark.parametrize("law", ["inside", "always"])
@pytest.mark.parametrize("name", RIGS)
def test_dead_stretches_identify_gap_and_damping_without_a_simulation(name, law, damping):
    """Half gap within 1.5 %, the damping in the gap within 3 % of all, whatever damping the drive believes in."""
    machine = rig(name, law, damping)
    found = crossings(task_of(machine, damping=40.0))
    assert len(found) == len(CONTACT_TORQUE_SHARES)
    for seen in found:
        assert seen.half_gap == pytest.approx(machine.half_gap[0], rel=0.015) and seen.count > 10
        assert seen.open == pytest.approx(damping if law == "always" else 0.0, abs=0.03 * damping + 0.02)
        assert abs(seen.half_gap - machine.half_gap[0]) < 3.0 * seen.spread


def test_a_gap_that_is_not_crossed_has_no_dead_stretch():
    closed = replace(TABLE, half_gap=(0.0,))
    assert all(c.half_gap < 1e-3 for c in crossings(task_of(closed)))
    without = task_of(rig("light", "always", 0.863), roles=ROLES[:2])
    assert crossings(without) == [] and fit_gap_laws(without, Options()) is None


@pytest.mark.slow
@pytest.mark.parametrize("law", ["inside", "always"])
def test_the_law_of_the_machine_is_named_and_its_gap_found(law):
    """The drive knows the damping of the closed gap, a tenth of what acts, and the other law."""
    machine = rig("light", law, 0.863)
    task = task_of(machine, 6)
    drive = replace(task.drive, damping_law="always" if law == "inside" else "inside",
                    values=task.drive.values | {"shaft.damping": 0.083})
    estimate = backlash(task.experiments, drive, Options())
    lines = {p.name: p for p in estimate.parameters}
    (finding,) = [f for f in estimate.findings if f.code == "gap-law"]
    assert estimate.drive.damping_law == law and finding.evidence["log_likelihood_lead"] > 100.0
    for name, true in (("shaft.half_gap", 0.156), ("shaft.damping", 0.863)):
        assert abs(lines[name].value - true) < 3.0 * lines[name].std, name
    assert lines["shaft.half_gap"].std < 1e-3 * 0.156
    assert estimate.details["dead_stretches"]["half_gap"] == pytest.approx(0.156, rel=0.01)
    assert not [f for f in estimate.findings if f.severity != "note"]


@pytest.mark.slow
@pytest.mark.parametrize(("lead", "code"),
                         [(0.6 * MIN_LAW_LEAD, "gap-law"), (1.6 * MIN_LAW_LEAD, "gap-law")])
def test_a_law_is_named_from_seven_of_log_likelihood_on(lead, code):
    assert 4.5 < MIN_LAW_LEAD < 9.0
    both = fit_gap_laws(task_of(rig("heavy", "always", 0.863), damping=0.5), Options())
    better = both.outcome
    other = both.each["inside"]
    near = replace(both, each={"always": better, "inside": replace(
        other, fit=replace(other.fit, value=better.fit.value + lead))})
    found = gap_law_finding(near, "shaft")
    assert found.code == code
    # The lead of a fit that diverged from its start does not count.
    assert gap_law_finding(near, "shaft", converged=False).code == "gap-law"
    assert {"half_gap_inside", "half_gap_always", "damping_inside", "damping_always"} <= set(found.evidence)
    assert f"{found.evidence['half_gap_inside']:.4g} rad" in found.text


def test_a_half_gap_that_is_held_is_not_looked_for():
    task = task_of(rig("heavy", "always", 0.863))
    assert fit_gap_laws(replace(task, free=("shaft.damping",)), Options(hold=("shaft.half_gap",))) is None
    assert fit_gap_laws(replace(task, free=("shaft.half_gap", "shaft.half_gap@gap")), Options()) is None


@pytest.mark.slow
def test_the_tie_is_of_those_that_tie_and_the_law_of_the_file_stays_among_them():
    laws = fit_gap_laws(task_of(rig("heavy", "always", 0.863), damping=0.5), Options())

    def with_values(**values):
        each = {law: replace(o, converged=True, fit=replace(o.fit, value=values[law]))
                for law, o in laws.each.items()}
        best = min(each.values(), key=lambda o: o.fit.value)
        return replace(laws, outcome=best, each=each)
    near = with_values(inside=100.0, always=3.0, contact=0.0)
    assert near.tied == ["always", "contact"] and near.lead == 3.0
    text = gap_law_finding(near, "shaft").text
    assert "contact and in the gap or the damping acts in contact only and the shaft relaxes" in text
    assert near.with_own("always").outcome.drive.damping_law == "always" and near.with_own("always").lead == -3.0
    assert near.with_own("inside").outcome.drive.damping_law == "contact"
    clear = with_values(inside=100.0, always=30.0, contact=0.0)
    assert clear.lead == 30.0 and "supports one law" in gap_law_finding(clear.with_own("always"), "shaft").text


@pytest.mark.slow
def test_a_law_whose_rival_has_no_fit_is_not_named():
    both = fit_gap_laws(task_of(rig("heavy", "always", 0.863), damping=0.5), Options())
    found = gap_law_finding(replace(both, each={"always": both.outcome}), "shaft")
    assert found.code == "gap-law" and "Only one law" in found.text and "inf" not in found.text


@pytest.mark.slow
def test_where_the_damping_is_held_it_stays():
    task = task_of(rig("heavy", "always", 0.863))
    found = backlash(task.experiments, task.drive, Options(hold=("shaft.damping",)))
    line = {p.name: p for p in found.parameters}["shaft.damping"]
    assert line.status == "held" and line.value == 0.863
    assert abs(found.drive.values["shaft.half_gap"] - 0.131) < 2.6e-4




@pytest.mark.slow
@pytest.mark.parametrize(("law", "own"), [(law, own) for law in ("inside", "always", "contact")
                                         for own in ("inside", "always", "contact")
                                         if (law, own) != ("always", "contact")])
def test_the_law_is_named_where_the_motor_alone_is_measured(law, own):
    """The drive is described by any law; gap and damping come out by the machine's.

    From "contact" the fit of a machine by "always" does not converge, and no law is stated.
    """
    machine = rig("heavy", law, 2.01)
    task = task_of(machine, 6, roles=ROLES[:2])
    drive = replace(task.drive, damping_law=own, values=task.drive.values | {"shaft.half_gap": 0.1})
    estimate = backlash(task.experiments, drive, Options(free=("shaft.damping",)))
    (finding,) = [f for f in estimate.findings if f.code == "gap-law"]
    assert estimate.drive.damping_law == law and finding.evidence["log_likelihood_lead"] > MIN_LAW_LEAD
    lines = {p.name: p for p in estimate.parameters}
    for name, true in (("shaft.half_gap", 0.131), ("shaft.damping", 2.01)):
        assert abs(lines[name].value - true) < 3.0 * lines[name].std, name
    assert "dead_stretches" not in estimate.details


@pytest.mark.slow
def test_a_gap_without_damping_requires_no_law():
    task = task_of(rig("heavy", "inside", 2.01), 6, roles=ROLES[:2])
    drive = replace(task.drive, values=task.drive.values | {"shaft.half_gap": 0.1, "shaft.damping": 0.0})
    estimate = backlash(task.experiments, drive, Options())
    gap, damping = ({p.name: p for p in estimate.parameters}[f"shaft.{n}"] for n in ("half_gap", "damping"))
    assert gap.status == "fitted" and gap.value == pytest.approx(0.131, rel=0.01) and damping.value == 0.0
    assert not [f for f in estimate.findings if f.code == "gap-law"]
