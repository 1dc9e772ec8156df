"""What the rounds of a diagnosis have found, and what each of it leaves open."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType

from drivetool.check.decide import Decision

APART = 0.1  # relative difference from which a ripple is of another order, a step at another instant


@dataclass
class Found:
    """The causes found so far.

    causes    codes in the order found
    rivals    cause -> what explains the records as well; tied: cause -> all that did in its round
    evidence  cause -> log10 of the evidence
    added     cause -> names of the parameters that it freed
    places    cause -> of each that tied with it, the order or instant that it was searched for, if any
    gained    log likelihood by all of them on data held out
    sure      causes that data held out tell beside those that were found after them
    """

    causes: list[str] = field(default_factory=list)
    rivals: dict[str, tuple[str, ...]] = field(default_factory=dict)
    tied: dict[str, tuple[str, ...]] = field(default_factory=dict)
    evidence: dict[str, float] = field(default_factory=dict)
    added: dict[str, tuple[str, ...]] = field(default_factory=dict)
    places: dict[str, Mapping[str, float]] = field(default_factory=dict)
    gained: float = 0.0
    sure: set[str] = field(default_factory=set)

    def take(self, code: str, decision: Decision, added: Sequence[str], gain: float,
             places: Mapping[str, float] = MappingProxyType({})) -> None:
        """A further cause, as a round has decided; which parameters it frees, and what it gains.

        places  order or instant of each cause that ties, where it has one
        """
        elsewhere = [c for c, own in self.places.items()
                     if code in own and abs(own[code] - places.get(code, own[code])) > APART * abs(own[code])]
        self.rivals = rivals_with(self.rivals, code, decision.between, elsewhere)
        self.places[code] = dict(places)
        self.tied[code], self.evidence[code], self.added[code] = decision.between, decision.evidence, tuple(added)
        self.causes.append(code)
        self.gained += gain

    def drop(self, code: str) -> None:
        """A cause that a later one has made needless."""
        self.causes.remove(code)
        self.evidence.pop(code, None)
        self.rivals = rivals_without(self.rivals, code, self.tied.get(code, ()))

    def unsure(self, before: Sequence[str]) -> list[str]:
        """The causes that were found beside one that is gone, and did not tie with it.

        What rivals them without it is not known.

        before  the causes while that was among them
        """
        gone = [c for c in before if c not in self.causes and c in self.added]
        return [c for c in self.causes if c in before
                and any(before.index(g) < before.index(c) and c not in self.tied.get(g, ()) for g in gone)]

    def reopen(self, code: str, between: Sequence[str]) -> None:
        """What explains the records as well as a cause, asked again beside what is left."""
        self.rivals[code] = tuple(c for c in between if c not in self.causes)

    def rename(self, code: str, simple: str, added: Sequence[str]) -> None:
        """Call a cause by its special case, which has these parameters.

        That is there beside the others then, and rivals none of them.
        """
        self.causes[self.causes.index(code)] = simple
        self.evidence[simple], self.added[simple] = self.evidence.pop(code), tuple(added)
        self.tied[simple] = self.tied.pop(code, ())
        self.rivals[simple] = self.rivals.pop(code, ())
        self.rivals = {c: tuple(r for r in others if r != simple) for c, others in self.rivals.items()}

    @property
    def between(self) -> tuple[str, ...]:
        """The causes that have rivals, and those, in the order found."""
        return tuple(dict.fromkeys(c for code in self.causes for c in (code, *self.rivals.get(code, ()))
                                   if self.rivals.get(code)))


def rivals_with(rivals: Mapping[str, Sequence[str]], code: str, between: Sequence[str],
                elsewhere: Sequence[str] = ()) -> dict[str, tuple[str, ...]]:
    """Cause -> what explains the record as well, once a further cause is found.

    A rival of an earlier cause that is found, too, is there beside it: not one or the other, but both. So is what
    the record does not tell from that rival.

    between    the causes that explained the record equally well in this round, the one that is taken among them
    elsewhere  earlier causes whose rival of that code was a ripple of another order, say: that is not found yet
    """
    left = {c: tuple(r for r in others if c in elsewhere or code not in others or r not in between)
            for c, others in rivals.items()}
    return left | {code: tuple(c for c in between if c != code)}


def rivals_without(rivals: Mapping[str, Sequence[str]], code: str, tied: Sequence[str],
                   ) -> dict[str, tuple[str, ...]]:
    """Cause -> what explains the record as well, once a cause is taken out that a later one has made needless.

    Rivals of the later one were as good beside what it has replaced; alone only those are that tied there, too.

    tied  the causes that explained the record equally well when the one that goes was found
    """
    return {c: tuple(r for r in others if c not in tied or r in tied) for c, others in rivals.items() if c != code}
