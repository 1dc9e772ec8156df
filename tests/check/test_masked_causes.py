"""Causes that hide each other: when they are looked for together, and when what is found so is taken."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from drivetool.check.causes.catalogue import CAUSES
from drivetool.check.fit.model import sensor_std
from drivetool.check.search import masked_causes
from drivetool.check.search.decision import Decision
from drivetool.check.search.masked_causes import find_masked_causes, is_inconclusive
from drivetool.check.search.result import SelectedCauses
from drivetool.check.search.search import Expansion, Node
from drivetool.drive.chain import three_mass
from drivetool.drive.simulation import Trace
from tests.check.models import Unfolded, ended, model_over, task_of, true_model
from tests.diagnosed import gain
from tests.recover import STEP

NOISE = 0.02  # rad/s of the sensor


@pytest.mark.parametrize(("causes", "confident", "left", "before", "after", "share", "expected"), [
    (("backlash",), True, 0.0, 27.0, 1.1, 0.01, False),
    (("backlash",), False, 900.0, 27.0, 1.1, 0.01, True),  # much is left
    ((), True, 0.0, 27.0, 27.0, 0.5, False),  # white: that noise is one
    ((), True, 40.0, 27.0, 27.0, 0.01, False),
    ((), True, 40.0, 27.0, 27.0, 0.5, True),  # an implausible noise replaces a law
    (("backlash",), True, 0.0, 2.0, 1.4, 0.5, False),  # hardly more than the sensor's own
    (("backlash",), True, 0.0, 1.0, 1.2, 0.01, True)])  # free runs become worse
def test_large_residuals_or_an_implausible_noise_are_doubtful(
        causes, confident, left, before, after, share, expected):
    model = true_model(NOISE)
    torque = model.noise.ratio * sensor_std(model) / share  # the size of the torque for this share of noise
    first = model_over(Trace(np.array([[torque], [-torque]]), np.zeros((2, 1)), STEP))
    found = SelectedCauses(causes, gained=1e4 if confident else 0.0)
    result = ended(model, first=first, left=left, found=found,
                   gain=gain(before * NOISE, after * NOISE, floor=NOISE))
    assert result.confident is confident and is_inconclusive(result) is expected


def step(node, code, value):
    child = replace(node, causes=(*node.causes, code), model=replace(node.model, value=value), trained=("folds",))
    return Expansion(node, (), Decision(None, (code,), 0.0), (), child)


def found_together(monkeypatch, ends, block_lead=1.0, drive=None, first="coulomb-load", wanted=CAUSES, fails=False):
    """What is found where a gap is put first; ends: value of the gap, and then of each cause beside it."""
    root = Node((), replace(true_model(), task=task_of((), drive)), ("folds",))
    path = [step(root, first, -100.0)]
    gap = step(root, "backlash", ends[0])

    class Given(Unfolded):
        def path(self, node):
            if fails:
                raise FloatingPointError
            steps, codes = [], ("coulomb-load", "imbalance")
            for code, value in zip(codes, ends[1:], strict=False):
                steps.append(step(node, code, value))
                node = steps[-1].child
            return [*steps, Expansion(node, (), Decision(None, (), 0.0), ())], ""

    monkeypatch.setattr(masked_causes, "_forced_expansion", lambda search, code,
                        _: gap if code == "backlash" else None)
    monkeypatch.setattr(masked_causes, "lead_in_blocks", lambda *_: [block_lead, block_lead])
    search = Given(wanted, root=root.model)
    search.causes = list(CAUSES.values())  # those that are looked for beside the requested ones, too
    return find_masked_causes(search, path)


@pytest.mark.parametrize(("ends", "block_lead", "causes"), [
    ((-20.0, -130.0), 1.0, ["backlash", "coulomb-load", None]),
    ((-20.0, -115.0), 1.0, None),  # no likelier by what counts as a lead
    ((-20.0, -130.0), -1.0, None),  # samples held out speak against both
    ((-130.0,), 1.0, None)],  # a gap alone was looked for before
                         ids=["both", "no likelier", "predicts worse", "alone"])
def test_what_is_likelier_together_and_predicts_better_is_taken(monkeypatch, ends, block_lead, causes):
    found = found_together(monkeypatch, ends, block_lead)
    assert (found and [e.child and e.child.causes[-1] for e in found[0]]) == causes


@pytest.mark.parametrize("options", [
    {"drive": three_mass()}, {"first": "backlash"}, {"wanted": {"coulomb-load", "imbalance"}}, {"fails": True}],
                         ids=["three bodies", "found already", "not requested", "its fit fails"])
def test_where_a_gap_is_not_put_first(monkeypatch, options):
    assert found_together(monkeypatch, (-20.0, -130.0), **options) is None
