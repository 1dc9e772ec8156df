"""The declaration of a cause of diagnose: one per cause, in its own file."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

from drivetool.check.starts import Bounds, Start
from drivetool.quantity import parse_name

if TYPE_CHECKING:
    from drivetool.check.fit import Masks, Model
    from drivetool.check.outcome import State
    from drivetool.identify.setup import Task


@dataclass(frozen=True)
class Cause:
    """A cause that a model may lack.

    code         in files and on the command line; name: in a table
    text         what the machine does, one sentence; look: what to do about it
    effect       code of the effect that is its law; None: it is a fault of the recording
    of, law      what it belongs to, and its equation in words, where no effect says it
    starts       (base) -> where fits start; empty if the base has it, or drive or record cannot identify it. None:
                 it is found in the record without a fit
    sizes        suffixes of the parameters that give its size, the most important one first
    bodies       fewest bodies of a drive that can have it
    needs        what a record must contain to identify it, where no effect says it
    further      codes of effects that are the same cause in another form
    end          the body that has it: the motor, one behind it, or any
    special      codes of causes that are special cases of this one
    alike        code of a look-alike cause -> the experiment that decides between the two, stated in one of both
                 files
    response     codes of causes with the same response of a linear drive, which differ in the noise they pass
    absent       state and reason where it has no starts, if its effect does not state them
    trace        (base) -> a start with a very small size, where the linearisation at the neutral value gives no
                 detection limit; None: there is no such start, or `starts` have amplitudes
    bounds       (base, task) -> bounds of its parameters during the search
    imposed      as `starts`, where the motion is imposed; None: the required torque does not identify it
    implausible  (model with it, base) -> why it is rejected; empty: it is plausible
    place        suffix of the parameter that gives its order or its time
    located      suffixes of parameters that parts of a record do not identify: found in all of it, and held then
    searched     suffixes of parameters that were scanned over the whole record, each at a price in evidence
    event        whether it acts in parts of a record only
    power        power of the gear ratio by which its value is smaller referred to the motor, of a law that any body
                 may have; 0: none
    costly       whether its starts cost fits: tested only where nothing else explains the records
    multimodal   whether its likelihood has many local optima, all of which are followed
    ends         (base, samples) -> ends of fits by a search of its own, the likeliest first
    refined      (model with it, base, samples, refitted) -> the same with parameters that only a finished fit
                 identifies; refitted: a function of the search that fits it with other parameters free
    another      (model with it, samples, best_start) -> the same with one more instance, at another order, say;
                 None: no further one is found; best_start: a function of the search that chooses a start
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
    absent: tuple[State, str] | None = None
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
    multimodal: bool = False
    ends: Callable[[Model, Masks], Sequence[Model]] | None = None
    refined: Callable[[Model, Model, Masks, Callable], Model] | None = None
    another: Callable[[Model, Masks, Callable], Model | None] | None = None

    @property
    def of_record(self) -> bool:
        """Whether it is found in the record without a fit."""
        return self.starts is None

    def has(self, name: str) -> bool:
        """Whether a parameter gives its size: of friction at one end of the drive, that of this end."""
        owner, quantity, _ = parse_name(name)
        at_end = {"motor": owner == "motor", "load": owner != "motor", "any": True}
        return quantity in self.sizes and at_end[self.end]
