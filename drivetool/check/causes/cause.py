"""The form in which every cause that diagnose looks for declares itself, once, in its own file."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

from drivetool.check.starts import Bounds, Start

if TYPE_CHECKING:
    from drivetool.check.fit import Masks, Model
    from drivetool.check.outcome import State
    from drivetool.identify.setup import Task


@dataclass(frozen=True)
class Cause:
    """A cause that a model may lack.

    code         in files and on the command line; name: in a table
    text         what the machine does, one sentence; look: what to do about it
    effect       code of the effect that is its law; None: it is one of the recording
    of, law      what it belongs to, and its equation in words, where no effect says it
    starts       (base) -> where fits start; none if the base has it, or drive or record cannot show it. None: it is
                 read off the record, by no fit
    sizes        suffixes of the parameters that say how large it is, the most telling one first
    bodies       fewest bodies of a drive that can have it
    needs        what a record must contain to show it, where no effect says it
    further      codes of effects that are the same cause in another form
    end          the body that has it: the motor, one behind it, or any
    special      codes of causes that are special cases of this one
    alike        code of another cause that looks like it -> the experiment that decides between the two, said in
                 one of both files
    response     codes of causes that make the same motion of a linear drive, and differ in the noise they let pass
    absent       (base) -> state and reason where it has no starts, if that is not what its effect says
    trace        (base) -> a start with hardly any of it, where no linear step at the neutral value tells what the
                 record resolves; None: there is no such start, or `starts` have amplitudes
    bounds       (base, task) -> how far its parameters may go while it is looked for
    imposed      the same as `starts` where the motion is imposed and the torque is judged; None: that torque does
                 not tell it
    implausible  (model with it, base) -> why it is none after all; empty: it may be one
    place        suffix of the parameter that says where or at which order it is
    located      suffixes of parameters that parts of a record cannot tell: found in all of it, and held then
    searched     suffixes of parameters of which the whole record was looked at, each at a price in evidence
    event        whether parts of a record see it unequally
    power        power of a gear by which a value behind it counts less, of a law that any body may have; 0: none
    costly       whether its starts cost fits: looked for where nothing else explains the records
    rough        whether its likelihood has many valleys, all of which are followed
    ends         (base, samples) -> ends of fits by a search of its own, the likeliest first
    refined      (model with it, base, samples, refitted) -> the same with what only a finished fit can tell;
                 refitted: a function of the search that fits it with other parameters free
    another      (model with it, samples, most_promising) -> the same with one more of its kind, at another order,
                 say; None: none is asked for; most_promising: a function of the search that chooses a start
    """

    code: str
    name: str
    text: str
    look: str
    effect: str | None = None
    of: str = "the recording"
    law: str = ""
    starts: Callable[[Model], list[Start]] | None = None
    sizes: tuple[str, ...] = ()
    bodies: int = 1
    needs: str = ""
    further: tuple[str, ...] = ()
    end: Literal["motor", "load", "any"] = "any"
    special: tuple[str, ...] = ()
    alike: Mapping[str, str] = field(default_factory=dict)
    response: tuple[str, ...] = ()
    absent: Callable[[Model], tuple[State, str]] | None = None
    trace: Callable[[Model], Start] | None = None
    bounds: Callable[[Model, Task], Bounds] | None = None
    imposed: Callable[[Model], list[Start]] | None = None
    implausible: Callable[[Model, Model], str] | None = None
    place: str = ""
    located: tuple[str, ...] = ()
    searched: tuple[str, ...] = ()
    event: bool = False
    power: int = 0
    costly: bool = False
    rough: bool = False
    ends: Callable[[Model, Masks], Sequence[Model]] | None = None
    refined: Callable[[Model, Model, Masks, Callable], Model] | None = None
    another: Callable[[Model, Masks, Callable], Model | None] | None = None

    @property
    def of_record(self) -> bool:
        """Whether it is read off the record, by no fit."""
        return self.starts is None

    def has(self, name: str) -> bool:
        """Whether a parameter says how large it is: of friction at one end of the drive, that end's own."""
        owner, _, suffix = name.rpartition(".")
        here = {"motor": owner == "motor", "load": owner != "motor", "any": True}
        return suffix in self.sizes and here[self.end]
