"""Stored facts judged again, with and without a rule."""

from __future__ import annotations

from collections import Counter

from drivetool.check.outcome import Facts
from drivetool.check.verdict import RULES
from drivetool.files.yaml import to_plain
from tests.study.ablation import graded, without_each

CLEAR = Facts(causes=("backlash",), strongest="backlash", gained=300.0, after=0.3, floor=0.02)
NOISY = Facts(causes=("backlash",), strongest="backlash", gained=300.0, after=0.9, floor=0.1, torque_noise=0.08)


def row(facts, truth, removed=()):
    return {"facts": to_plain(facts), "to_name": list(truth), "removed": list(removed)}


def test_grades_are_those_of_the_studies():
    assert graded(row(CLEAR, ["backlash"]), RULES) == "right"
    assert graded(row(CLEAR, ["imbalance"]), RULES) == "wrong"
    assert graded(row(CLEAR, []), RULES) == "false-alarm"
    assert graded(row(CLEAR, ["backlash"], ["backlash"]), RULES) == "wrong"
    assert graded({"facts": to_plain(CLEAR), "law": "shaft.gap"}, RULES) == "right"
    assert graded({"facts": to_plain(CLEAR), "law": "motor.crank"}, RULES) == "wrong"


def test_a_rule_is_worth_the_answers_that_change_without_it():
    found = [row(NOISY, ["backlash"], ["backlash"]), row(NOISY, ["backlash"]), row(CLEAR, ["backlash"])]
    table = {name: (decides, changed) for name, decides, changed in without_each(found)}
    assert table["noise-hides-a-law"] == (2, Counter({("right", "wrong"): 1, ("undetermined", "right"): 1}))
    assert table["rivals"] == (0, Counter()) and "explained" not in table
