"""Recordings of simulated machines at 500 Hz, as bytes, with the parameter file to start from."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from tests.hidden import case as hidden_case, profiles
from tests.hidden.case import make_case
from tests.hidden.start import greybox_options, write_start

STEP = 2e-3


@dataclass(frozen=True)
class Machine:
    """Name -> content: record1, holdout, start.yaml; options keep a plain fit plain."""

    files: Mapping[str, bytes]
    options: str


@contextmanager
def sampled(step: float) -> Iterator[None]:
    """Experiments and records of the hidden machines at another interval."""
    modules, before = (hidden_case, profiles), hidden_case.STEP
    for module in modules:
        module.STEP = step
    try:
        yield
    finally:
        for module in modules:
            module.STEP = before


def hidden(effects: Sequence[str], seed: int, bodies: int = 2, duration: float = 3.0, **more) -> Machine:
    """Records of a machine with hidden effects; `more` as in `make_case`."""
    with sampled(STEP), tempfile.TemporaryDirectory() as folder:
        made = make_case(list(effects), seed, bodies=bodies, duration=duration, **more)
        made.write_records(Path(folder))
        write_start(made, Path(folder))
        files = {path.name: path.read_bytes() for path in sorted(Path(folder).iterdir())}
    return Machine(files, "".join(f" {word}" for word in greybox_options(made)))
