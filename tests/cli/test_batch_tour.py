"""The README's tour as a site of three machines: the same bytes as by hand."""

import subprocess
import sys
from pathlib import Path

import pyarrow.parquet as pq
import pytest

from tests import sites
from tests.places import RIG

# step, recording, files of earlier steps, further words
TOUR = (("steady", "steady", (), ""), ("blackbox", "steps", ("steady",), ""),
        ("greybox", "steps", ("steady", "blackbox"), ""),
        ("backlash", "gap", ("greybox",), "--free all --hold total.viscous"),
        ("validate", "gap", ("backlash",), "--segment 1"))
MACHINES = ("press1", "press2", "press3")


def write_recordings():
    """Those of the tour, each of another content in each machine."""
    for machine in MACHINES:
        for name in ("steady", "steps", "gap"):
            read = pq.read_table(RIG / f"{name}.parquet")
            path = Path("logs", machine, f"{name}.parquet")
            path.parent.mkdir(parents=True, exist_ok=True)
            pq.write_table(read.replace_schema_metadata({**(read.schema.metadata or {}), "of": machine}), path)


@pytest.mark.slow
def test_the_tour_of_three_machines_is_as_by_hand(here, call):
    write_recordings()
    sites.write_site(
        here, [{"files": f"logs/*/{kind}.parquet", "kind": kind} for kind in ("steady", "steps", "gap")],
        [{"kind": kind, "command": f"{step} {more}".strip(), "params": list(params)}
         for step, kind, params, more in TOUR])
    code, _, err = call("batch", "site.yaml", "--workers", "1")
    assert code == 0 and "15 results, 15 of them run now, 0 with a problem" in err, err
    for machine in MACHINES:
        for step, name, params, more in TOUR:
            words = [step, f"logs/{machine}/{name}.parquet", *more.split(), "--quiet"]
            words += ["--out", f"{machine}/{step}.yaml"]
            words += [word for earlier in params for word in ("--params", f"{machine}/{earlier}.yaml")]
            subprocess.run([sys.executable, "-m", "drivetool", *words], check=True)
            mine = here / "site-results/logs" / machine / name / f"{step}.yaml"
            assert mine.read_bytes() == Path(machine, f"{step}.yaml").read_bytes(), (machine, step)
    assert call("batch", "site.yaml", "--verify")[0] == 0
