"""Which explanation is chosen, and what the others add to the interval."""

from dataclasses import replace
from types import MappingProxyType

import numpy as np
import pytest

from drivetool.drive import one_body, two_mass
from drivetool.identify.estimate.interval_and_status import Z95
from drivetool.identify.laws import explanation
from drivetool.identify.laws.candidates import Candidate, CandidateSet
from drivetool.identify.laws.explanation import (
    DISAGREEMENT_FACTOR,
    MAX_CREDIBLE_ERROR_RATIO,
    MAX_FREE_RUN_ERROR_RATIO,
    MAX_PREFERRED_ERROR_RATIO,
    choose_candidate,
    parameter_uncertainty,
)
from drivetool.identify.laws.free_run_test import FreeRunTest
from drivetool.identify.laws.influence import sandwich_covariance
from drivetool.identify.motion.linear import INFLUENCE_BLOCKS
from drivetool.identify.motion.motion import Smoothing
from drivetool.identify.noise.noise import Noise
from drivetool.identify.setup.task import Task

ALL = {"coloured, laws": 1.0, "white, laws": 1.0, "regression, laws": 1.0, "coloured": 1.0, "white": 1.0,
       "regression": 1.0, "free runs, laws": 1.0}

FREE = ("motor.viscous", "motor.coulomb")


def errors(**others):
    """All err alike but for some, named by their first letters: cl is 'coloured, laws'."""
    names = {"cl": "coloured, laws", "wl": "white, laws", "rl": "regression, laws", "c": "coloured", "w": "white",
             "r": "regression", "f": "free runs, laws"}
    return ALL | {names[k]: v for k, v in others.items()}


@pytest.mark.parametrize("table, name", [
    ({}, "coloured, laws"),  # the most efficient where all err alike
    ({"cl": 1.19}, "coloured, laws"), ({"cl": 1.21}, "white, laws"),
    ({"cl": 2.0, "wl": 1.21}, "regression, laws"),
    ({"cl": 2.0, "wl": 1.9, "rl": 1.8, "c": 1.3, "w": 1.1}, "regression"),  # the best of all, without laws too
    ({"cl": 2.0, "wl": 1.9, "rl": 1.8, "r": 1.3, "w": 1.1}, "coloured"),
    ({"f": 0.68}, "coloured, laws"), ({"f": 0.65}, "free runs, laws"),
    ({"f": 0.1}, "free runs, laws"), ({"f": 5.0}, "coloured, laws")])
def test_the_choice_follows_the_free_runs(table, name):
    assert choose_candidate(errors(**table)) == name


def test_the_thresholds_are_where_they_are_said_to_be():
    # Twice or half of either would turn one of these over.
    assert choose_candidate(errors(cl=0.99 * MAX_PREFERRED_ERROR_RATIO)) == "coloured, laws" and choose_candidate(
        errors(cl=1.01 * MAX_PREFERRED_ERROR_RATIO)) == "white, laws"
    assert (MAX_PREFERRED_ERROR_RATIO, MAX_FREE_RUN_ERROR_RATIO, MAX_CREDIBLE_ERROR_RATIO) == (1.2, 1.5, 2.0)
    assert choose_candidate(errors(cl=1.01, f=1.02 / MAX_FREE_RUN_ERROR_RATIO)) == "coloured, laws"
    assert choose_candidate(errors(cl=1.01, f=0.99 / MAX_FREE_RUN_ERROR_RATIO)) == "free runs, laws"


@pytest.mark.parametrize("table, name", [
    ({}, "regression, laws"), ({"rl": 1.21}, "regression"), ({"rl": 1.19, "cl": 0.2}, "regression, laws"),
    ({"rl": 1.6, "r": 1.3, "f": 0.9}, "regression"), ({"f": 0.6}, "free runs, laws")])
def test_a_measured_torque_keeps_to_the_regression(table, name):
    assert choose_candidate(errors(**table), measured=True) == name


def test_a_drive_that_cannot_be_regressed_has_fewer_candidates():
    table = {n: e for n, e in errors(cl=1.3).items() if not n.startswith("regression")}
    assert choose_candidate(table) == "white, laws"


def candidate(values, seed=1, std=0.01, covariance=0.01):
    influence = std / 4.0 * np.random.default_rng(seed).standard_normal((INFLUENCE_BLOCKS, 2))
    return Candidate(None, np.array(values), influence, covariance**2 * np.eye(2), None, np.empty(0),
                     np.empty((INFLUENCE_BLOCKS, 0)), np.eye(2), np.full(2, np.inf))


def field(**off):
    """All agree but for some: first letters -> values."""
    names = {"cl": "coloured, laws", "wl": "white, laws", "rl": "regression, laws", "f": "free runs, laws"}
    one = candidate([1.0, 2.0])
    candidates = dict.fromkeys(ALL, one) | {names[k]: candidate(v) for k, v in off.items()}
    judge = FreeRunTest({1.0: Smoothing(0.2, 0.0)}, Noise(1.0, None, np.ones(1)))
    return CandidateSet(MappingProxyType(candidates), (), judge, {}, Task(one_body(), FREE, None, ()))


def test_there_is_no_structure_where_all_agree():
    noise, structure, covariance = parameter_uncertainty(field(), errors(), "coloured, laws", FREE)
    assert structure == pytest.approx([0.0, 0.0])
    assert np.sqrt(np.diag(covariance)) == pytest.approx(noise)


@pytest.mark.parametrize("other", ["wl", "rl", "f"])
def test_structure_is_twice_the_disagreement_of_a_referee(other):
    for off in (0.1, 0.3):
        _, structure, _ = parameter_uncertainty(field(**{other: [1.0 - off, 2.0]}), errors(), "coloured, laws",
                                                FREE)
        # The same noise in both: none in the difference, all of which counts as a half-width and as much again.
        assert structure == pytest.approx([2.0 * off / Z95, 0.0], rel=1e-9)
    assert DISAGREEMENT_FACTOR == 2.0


def test_the_noise_of_the_difference_does_not_count():
    one, other = candidate([1.0, 2.0], 1), candidate([1.05, 2.002], 2)
    f = field()
    f = replace(f, candidates={**f.candidates, "coloured, laws": one, "white, laws": other,
                               "regression, laws": one, "free runs, laws": one})
    _, structure, _ = parameter_uncertainty(f, errors(), "coloured, laws", FREE)
    one_std = np.std(one.influence - other.influence, axis=0, ddof=1) * np.sqrt(INFLUENCE_BLOCKS)
    assert one_std[0] < 0.05 and one_std[1] > 0.002
    assert structure == pytest.approx([2.0 * (0.05 - one_std[0]) / Z95, 0.0], rel=1e-9)


@pytest.mark.parametrize("other", ["wl", "rl", "f"])
def test_an_incredible_explanation_is_not_counted(other):
    disagreeing = field(**{other: [0.5, 2.0]})
    _, near, _ = parameter_uncertainty(disagreeing, errors(**{other: 1.9}), "coloured, laws", FREE)
    _, far, _ = parameter_uncertainty(disagreeing, errors(**{other: 2.1}), "coloured, laws", FREE)
    assert near[0] > 0.4 and far[0] == 0.0


@pytest.mark.parametrize("blocks, counted", [(1.6, False), (2.9, False), (3.1, True), (5.9, True)])
def test_a_candidate_value_from_two_blocks_alone_is_not_counted(blocks, counted):
    """1.6 fails where the least number is halved, 5.9 where it is doubled."""
    f = field(f=[0.5, 2.0])
    rare = replace(f.candidates["free runs, laws"], blocks=np.array([blocks, np.inf]))
    _, structure, _ = parameter_uncertainty(replace(f, candidates={**f.candidates, "free runs, laws": rare}),
                                            errors(),
                                            "coloured, laws", FREE)
    assert (structure[0] > 0.4) == counted


def test_free_runs_do_not_say_what_is_credible():
    _, structure, _ = parameter_uncertainty(field(wl=[0.5, 2.0]), errors(wl=1.9, f=0.7), "coloured, laws", FREE)
    assert structure[0] > 0.4


def test_noise_is_the_larger_of_both_estimates():
    f = field()
    by_blocks = np.sqrt(np.diag(sandwich_covariance(f.candidates["coloured, laws"].influence)))
    for covariance, expected in ((1e-6, by_blocks), (0.5, [0.5, 0.5])):
        one = candidate([1.0, 2.0], covariance=covariance)
        noise, _, _ = parameter_uncertainty(replace(f, candidates={**f.candidates, "coloured, laws": one}),
                                            errors(),
                                            "coloured, laws", FREE)
        assert noise == pytest.approx(expected)


def test_both_parts_make_the_covariance_with_their_correlations():
    f = field(rl=[1.1, 1.9])
    noise, structure, covariance = parameter_uncertainty(f, errors(), "coloured, laws", FREE)
    assert np.diag(covariance) == pytest.approx(noise**2 + structure**2)
    assert covariance[0, 1] == pytest.approx(-structure[0] * structure[1])  # the noise has no correlation here


def test_of_a_measured_torque_only_candidates_without_a_noise_model_count():
    disagreeing = field(cl=[0.5, 2.0], wl=[0.5, 2.0])
    _, structure, _ = parameter_uncertainty(disagreeing, errors(), "regression, laws", FREE, measured=True)
    assert structure == pytest.approx([0.0, 0.0])
    _, structure, _ = parameter_uncertainty(field(f=[0.5, 2.0]), errors(), "regression, laws", FREE, measured=True)
    assert structure[0] > 0.4


def test_every_kind_of_candidate_has_words():
    assert set(explanation.RESIDUAL_SENTENCES) == {name.partition(",")[0] for name in ALL}
    # The rival of a transmission's loss is compared with, and never chosen.
    assert {*explanation.COMPARED_CANDIDATES, *explanation.WITHOUT_LAWS} == {*ALL, explanation.OTHER_SHARE}


def test_what_runs_away_is_never_chosen():
    lost = candidate([1.0, 2.0])
    lost = replace(lost, influence=np.full_like(lost.influence, np.nan))
    assert explanation._free_run_error(field(), lost) == np.inf  # it is not even simulated
    assert choose_candidate(errors(cl=np.inf, f=np.inf)) == "white, laws"


def test_free_runs_are_no_candidate_for_the_friction_of_several_bodies():
    names = ("motor.inertia", "motor.viscous")
    given = field(f=[1.1, 2.2])
    several = replace(given, task=replace(given.task, drive=two_mass()))
    for one, friction in ((given, True), (several, False)):
        _, structure, _ = parameter_uncertainty(one, errors(), "coloured, laws", names)
        assert structure[0] > 0.05 and (structure[1] > 0.05) == friction
