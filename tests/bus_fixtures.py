"""The recordings of the bus, the drive as it is described to the tool, and its true values."""

from functools import cache

import yaml

from drivetool.drive import Drive
from drivetool.drive.chain import vehicle
from drivetool.logs.door import open_experiment
from tests.places import FIXTURES

BUS = {name: entry["value"] for name, entry in
       yaml.safe_load((FIXTURES / "bus" / "truth.yaml").read_text())["parameters"].items()}


@cache
def bus(name: str, suffix: str = "parquet"):
    """A recording of fixtures/bus."""
    return open_experiment(FIXTURES / "bus" / f"{name}.{suffix}")


def bus_drive() -> Drive:
    """Gear ratio, wheels and their radius as in drive.yaml, with the start value of the mass."""
    given = yaml.safe_load((FIXTURES / "bus" / "drive.yaml").read_text())["parameters"]
    return vehicle().with_values({name: entry["value"] for name, entry in given.items()})
