"""Build wheel and sdist, install each into an empty environment and run a pipeline with it: python .ci/installed.py

Nothing of the checkout may be needed then but the recording that is read.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import venv
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
RIG = ROOT / "fixtures" / "rig"
MAX_SIZE = 6e6  # of a package [bytes]: it is downloaded by every container


def run(*words: object, folder: Path) -> str:
    """A command outside the checkout, without the checkout's environment."""
    clean = {name: value for name, value in os.environ.items() if name not in ("PYTHONPATH", "VIRTUAL_ENV")}
    done = subprocess.run([str(word) for word in words], cwd=folder, env=clean, capture_output=True, text=True)
    if done.returncode != 0:
        sys.exit(f"{' '.join(map(str, words))}\nended with {done.returncode}:\n{done.stdout}{done.stderr}")
    return done.stdout


def try_out(package: Path, folder: Path) -> None:
    """Install the package with all that it requires, and let it fit and show a recording."""
    environment = folder / package.name.replace(".", "-")
    venv.create(environment, with_pip=True)
    run(environment / "bin" / "python", "-m", "pip", "install", "--quiet", "--disable-pip-version-check", package,
        folder=folder)
    tool, log, steps = environment / "bin" / "drivetool", RIG / "steady.parquet", RIG / "steps.parquet"
    version = run(tool, "--version", folder=folder).strip()
    if not package.name.startswith(version.replace(" ", "-")):
        sys.exit(f"{package.name} says that it is {version}")
    told = "from importlib.metadata import distribution as d; print(d('drivetool').read_text('licenses/LICENSE'))"
    licence = run(environment / "bin" / "python", "-c", told, folder=folder)
    if licence.strip() != (ROOT / "LICENSE").read_text().strip():
        sys.exit(f"{package.name} installs without its licence")
    page = "from drivetool.site.verdicts import index_page; print(index_page([], [], {}))"
    if "All 0 checks passed" not in run(environment / "bin" / "python", "-c", page, folder=folder):
        sys.exit(f"{package.name} makes no page")
    run(tool, "inspect", log, folder=folder)
    run(tool, "steady", log, "--out", "steady.yaml", folder=folder)
    shown = run(tool, "show", "steady.yaml", folder=folder)
    if "total.viscous" not in shown:
        sys.exit(f"{package.name} shows no viscous friction:\n{shown}")
    run(tool, "blackbox", steps, "--params", "steady.yaml", "--out", "blackbox.yaml", folder=folder)
    run(tool, "greybox", steps, "--params", "steady.yaml", "--params", "blackbox.yaml",
        "--out", "greybox.yaml", folder=folder)
    if "numba" in run(environment / "bin" / "python", "-m", "pip", "list", folder=folder):
        sys.exit(f"{package.name} requires Numba, which only a change of the kernel needs")
    if package.stat().st_size > MAX_SIZE:
        sys.exit(f"{package.name} has {package.stat().st_size / 1e6:.1f} MB, more than {MAX_SIZE / 1e6:.0f}")
    print(f"{package.name}: {version}, {package.stat().st_size / 1e6:.1f} MB, installed and used without Numba")


def main() -> None:
    """Both packages, in a folder that goes when all is done."""
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        run(sys.executable, "-m", "build", "--outdir", folder, ROOT, folder=folder)
        for package in sorted(folder.glob("drivetool-*")):
            try_out(package, folder)


if __name__ == "__main__":
    main()
