"""`make demo`: the whole chain on the fixture recordings, with the commands as one would type them."""

from __future__ import annotations

import shlex
import subprocess
import sys
from pathlib import Path

from drivetool.cli.output import DONE, MISSED, USAGE

# step, recording, files of earlier steps, further words
CHAIN = (
    ("steady", "steady.parquet", (), ()),
    ("blackbox", "steps.parquet", ("steady",), ()),
    ("greybox", "steps.parquet", ("steady", "blackbox"), ()),
    ("backlash", "gap.parquet", ("greybox",), ("--free", "all", "--hold", "total.viscous")),
    # Torque noise decides when a gap closes: no model simulates ten seconds of it in one run.
    ("validate", "gap_holdout.parquet", ("backlash",), ("--segment", "1")),
)


def demo(fixtures: Path, out: Path) -> int:
    """Run the chain; the exit code of the first step that was not done.

    fixtures  folder of the recordings
    out       folder for YAML files and pictures; made if it is missing
    """
    out.mkdir(parents=True, exist_ok=True)
    first = DONE
    for step, record, earlier, more in CHAIN:
        words = [step, str(fixtures / record), *more]
        for name in earlier:
            words += ["--params", str(out / f"{name}.yaml")]
        name = "validation" if step == "validate" else step
        code = _drivetool(*words, "--out", str(out / f"{name}.yaml"), "--plot", str(out))
        first = first or code
        if code not in (DONE, MISSED):  # 3 has written its file, so that the chain can go on
            return first
    for name in ("backlash", "validation"):
        first = _drivetool("show", str(out / f"{name}.yaml")) or first
    return first


def _drivetool(*words: str) -> int:
    """Print a command, then run it as the console script would."""
    print(f"\n$ drivetool {shlex.join(words)}", flush=True)
    return subprocess.run([sys.executable, "-m", "drivetool.cli.main", *words], check=False).returncode


if __name__ == "__main__":
    if len(sys.argv) != 3:
        print("usage: python -m drivetool.cli.demo FIXTURES_DIR OUT_DIR", file=sys.stderr)
        sys.exit(USAGE)
    sys.exit(demo(Path(sys.argv[1]), Path(sys.argv[2])))
