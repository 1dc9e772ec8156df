"""What parameter files state of a drive: values that are known, and start values that no recording identifies."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field

from drivetool.drive import Drive
from drivetool.finding import Finding


@dataclass(frozen=True)
class StatedDrive:
    """A drive from parameter files. Its values are no Drive until the reader says for what it takes them.

    start         every value, as the start of a fit: one that no recording identifies is known by nobody
    unidentified  name -> reason, of the values that are a start alone
    """

    start: Drive
    unidentified: Mapping[str, str] = field(default_factory=dict)

    @property
    def acting(self) -> dict[str, str]:
        """Those of the unidentified values whose effect is not absent, as it is in a file without them."""
        return {n: why for n, why in self.unidentified.items()
                if self.start.values[n] != self.start.quantity(n).neutral}

    def with_values(self, values: Mapping[str, float], unidentified: Mapping[str, str] | None = None,
                    ) -> StatedDrive:
        """The same with some values replaced, which are known except those in `unidentified`.

        raises  BadParameters: a name or a value that the drive cannot take
        """
        drive = self.start.with_values(values)
        others = {n: why for n, why in self.unidentified.items() if n in drive.values and n not in values}
        return StatedDrive(drive, {**others, **(unidentified or {})})

    def assumed(self, warn: bool = True) -> tuple[Drive, tuple[Finding, ...]]:
        """The drive with every value taken as if it were known, and the finding that names those that are not."""
        return self.start, self.doubts(self.unidentified, warn)

    def doubts(self, used: Collection[str], warn: bool = True) -> tuple[Finding, ...]:
        """The finding on unidentified values among those that a step uses; none if all of these are known.

        warn  whether it is a warning where one of them acts; otherwise it is a note
        """
        names = [n for n in self.unidentified if n in used]
        return (Finding(
            "warning" if warn and not self.acting.keys().isdisjoint(names) else "note", "unidentified-value",
            f"No recording identifies {', '.join(names)}: the parameter files state where a fit "
            "started, or a sum in one of its parts.",
            {n: self.start.values[n] for n in names},
            "Record what identifies it, or state a value that is known: with --set, or in the file without a "
            "status."),) if names else ()
