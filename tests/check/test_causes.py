"""The causes that can be named, and those that a fit or a look at the record can find: one catalogue."""

from drivetool.check.candidates import CANDIDATES
from drivetool.check.causes import CAUSES
from drivetool.drive.effects import EFFECTS

OF_THE_RECORD = {"outliers", "quantisation", "wrong-sign", "wrong-scale"}


def test_every_cause_can_be_found_and_every_candidate_has_words():
    codes = [c.code for c in CANDIDATES]
    assert len(codes) == len(set(codes)) and set(codes) | OF_THE_RECORD == set(CAUSES)


def test_candidates_stand_on_effects_of_the_drive():
    assert {c.effect for c in CANDIDATES} <= {e.code for e in EFFECTS}
    assert all(set(c.nests) <= set(CAUSES) for c in CANDIDATES)
