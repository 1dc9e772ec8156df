"""Blocks' shares of the error of a fit: the covariance that they go with, and the one that they make."""

import numpy as np
import pytest

from drivetool.identify.estimate.interval_and_status import covariance_of
from drivetool.identify.fit.engine import by_innovations, by_simulation, with_coloured_noise
from drivetool.identify.laws.influence import (
    FEW_BLOCKS_FACTOR,
    Scores,
    influence_of,
    sandwich_covariance,
    scores_of,
)
from drivetool.identify.motion.linear import INFLUENCE_BLOCKS
from tests.identify.test_law_selection import drawn


@pytest.mark.parametrize("situation, refit", [("white", lambda o: o), ("slow", with_coloured_noise)])
def test_the_covariance_is_that_of_the_information_matrix(situation, refit):
    outcome = refit(by_innovations(drawn(situation, "", 2, 52), [{}]))
    assert (outcome.fit.noise.memory is not None) == (situation == "slow")
    expected, _, _ = covariance_of(outcome.problem, outcome.solution)
    found, influence = influence_of(outcome)
    std = np.sqrt(np.diag(expected))
    np.testing.assert_allclose(found / np.outer(std, std), expected / np.outer(std, std), atol=0.02)
    assert influence.shape == (INFLUENCE_BLOCKS, 4)


def test_the_shares_of_an_arrived_fit_sum_up_to_nothing():
    outcome = by_innovations(drawn("white", "", 2, 52), [{}])
    _, influence = influence_of(outcome)
    assert influence.shape == (INFLUENCE_BLOCKS, 4)
    assert np.all(np.abs(influence.sum(axis=0)) < 0.05 * np.sqrt(np.diag(sandwich_covariance(influence))))


def test_under_white_noise_the_sandwich_is_near_the_information_matrix():
    ratios = []
    for number, seed in [(0, 50), (2, 52), (4, 54), (6, 56), (2, 57), (4, 58)]:
        covariance, influence = influence_of(by_innovations(drawn("white", "", number, seed), [{}]))
        ratios += (np.diag(sandwich_covariance(influence)) / np.diag(covariance)).tolist()
    # A variance of 16 blocks scatters by a third of itself; 24 of them, not independent, by a tenth or so.
    assert np.median(ratios) / FEW_BLOCKS_FACTOR**2 == pytest.approx(1.0, abs=0.35)


def test_correlated_errors_widen_the_sandwich_and_not_the_information_matrix():
    outcome = by_innovations(drawn("slow", "", 2, 52), [{}])  # taken as white
    covariance, influence = influence_of(outcome)
    assert np.max(np.diag(sandwich_covariance(influence)) / np.diag(covariance)) > 3.0


def test_free_runs_have_shares_that_are_those_of_a_step_of_gauss_newton():
    task = drawn("white", "", 2, 52)
    outcome = by_simulation(task, 1.0, [{}], near_optimum=True)
    problem, point = outcome.problem, outcome.solution.point
    _, influence = influence_of(outcome)
    # Refitted by one linear step to all but one block: near to what that block's share says.
    rows, block, done = [], [], 0
    for trace, plant, start in zip(problem.traces, problem.plants(point.values, True), point.starts, strict=True):
        _, j = plant.jacobian(trace, start)
        j = j[:, 0] / problem.scale[0]
        own = j[:, plant.system.nq + problem.free_start]
        rest = np.column_stack([j[:, :4], j[:, -1]])
        rows.append(rest - own @ np.linalg.lstsq(own, rest, rcond=None)[0])
        block += ((done + np.arange(trace.size)) * INFLUENCE_BLOCKS // sum(t.size for t in problem.traces)).tolist()
        done += trace.size
    rows, block = np.concatenate(rows), np.array(block)
    size = np.linalg.norm(rows[:, :4], axis=0)
    expected = np.array([-np.linalg.solve(
        (rows[:, :4] / size).T @ rows[:, :4] / size, (rows[block == b, :4] / size).T @ rows[block == b, 4]) / size
        for b in range(INFLUENCE_BLOCKS)])
    np.testing.assert_allclose(influence, expected, atol=1e-4 * np.abs(expected).max(axis=0).min(), rtol=1e-3)


def test_the_effective_number_of_blocks_is_that_of_equal_ones():
    """Of two parameters, one identified equally by four blocks and one almost by one alone: 1 / sum of squares."""
    each = np.zeros((INFLUENCE_BLOCKS, 2, 2))
    each[:4, 0, 0] = 2.0
    each[:3, 1, 1] = 8.0, 1.0, 1.0
    found = Scores(each, np.zeros((INFLUENCE_BLOCKS, 2)), 1.0).blocks
    np.testing.assert_allclose(found, [4.0, 1.0 / (0.64 + 0.01 + 0.01)])


def test_a_drive_under_steps_is_identified_by_most_blocks():
    found = scores_of(by_innovations(drawn("white", "", 2, 52), [{}])).blocks
    assert found.shape == (4,) and np.all((found > 4.0) & (found <= INFLUENCE_BLOCKS))
