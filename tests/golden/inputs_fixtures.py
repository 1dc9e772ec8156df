"""Every command on every fixture: the chains of the documents, and what is in each file."""

from __future__ import annotations

from pathlib import Path

from tests.golden import places
from tests.golden.case import Case, case, tool

FIXTURES = places.ROOT / "fixtures"
SHORT = "--condition 'keep from=0 to=4' --condition 'decimate factor=2'"

# Folder of fixtures -> chains, each with a name; the files are read in place, without a folder.
CHAINS: dict[str, dict[str, list[str]]] = {
    "rig": {
        "chain": [
            "steady steady.parquet -o steady.yaml --plot p1",
            "blackbox steps.parquet -p steady.yaml -o blackbox.yaml --plot p2",
            "greybox steps.parquet -p steady.yaml -p blackbox.yaml -o greybox.yaml --plot p3",
            "backlash gap.parquet -p greybox.yaml --free all -o backlash.yaml --plot p4",
            "validate gap_holdout.parquet -p backlash.yaml -o validate.yaml --plot p5",
            "validate steps_holdout.parquet gap_holdout.parquet -p greybox.yaml -p backlash.yaml --json",
            "simulate gap.parquet -p backlash.yaml -o simulated.parquet --plot p6",
            "spectra steps.parquet -o spectra.yaml --plot p7",
            "tune -p backlash.yaml --converter '433,0.69,2 ms' -o gains.yaml --plot p8",
            *[f"show {name}.yaml" for name in (
                "steady", "blackbox", "greybox", "backlash", "validate", "spectra", "gains", "truth")]],
        "compare": [
            "compare steps.parquet steps_holdout.parquet --structure oe --structure bj -o compare.yaml "
            "--plot p1",
            "show compare.yaml"],
        "mcap": [
            "steady steady.mcap -o steady.yaml",
            "blackbox steps.mcap -p steady.yaml --structure oe -o blackbox.yaml",
            f"greybox steps.mcap -p steady.yaml -p blackbox.yaml -o greybox.yaml {SHORT}",
            f"diagnose gap.mcap -p greybox.yaml -o diagnosis.yaml --candidates backlash,coulomb-motor {SHORT}",
            "show diagnosis.yaml"]},
    "reversing": {
        "chain": [
            "steady steady.parquet -o steady.yaml",
            f"blackbox moves.parquet -p steady.yaml -o blackbox.yaml {SHORT}",
            f"backlash moves.parquet -p steady.yaml --set motor.inertia=0.6 --set load.inertia=5.2 "
            f"--set shaft.stiffness=3300 --set shaft.damping=3 -o backlash.yaml {SHORT}",
            f"validate moves_holdout.parquet -p backlash.yaml --segment 1 {SHORT} -o validate.yaml",
            "spectra moves.parquet --json -q",
            "show validate.yaml"]},
    "axis": {
        "chain": [
            "greybox moves.parquet --drive one-body --set motor.inertia=80 --criterion inverse -o inverse.yaml "
            "--plot p1",
            f"greybox moves.parquet --drive one-body -p inverse.yaml -o greybox.yaml {SHORT}",
            "validate moves_holdout.parquet -p inverse.yaml --criterion inverse -o validate.yaml",
            "validate moves_holdout.parquet -p inverse.yaml -p greybox.yaml --segment 0.5 -o both.yaml",
            "diagnose moves.parquet -p inverse.yaml --criterion inverse -o diagnosis.yaml --explain",
            "show diagnosis.yaml", "show validate.yaml"]},
    "light": {
        "chain": [
            "steady steady.parquet --drive two-mass -o steady.yaml",
            "blackbox steps.parquet -p steady.yaml -o blackbox.yaml",
            f"greybox steps.parquet -p steady.yaml -p blackbox.yaml -o greybox.yaml {SHORT}",
            f"backlash gap.parquet -p greybox.yaml -o backlash.yaml {SHORT}",
            "validate gap_holdout.parquet -p backlash.yaml -o validate.yaml --segment 1 --plot p1",
            "tune -p backlash.yaml --converter 500 --configuration siso -o gains.yaml",
            "inspect steps.mcap -o inspect.yaml", "show backlash.yaml",
            "show inspect.yaml"]},
    "bus": {
        "chain": [
            "steady acceleration.parquet --method acceleration -p drive.yaml --set motor.inertia=4.5 "
            "-o rolling.yaml --plot p1",
            "steady uphill.parquet downhill.parquet --method acceleration -p drive.yaml -o slope.yaml",
            "blackbox prbs1.parquet --drive drive.yaml --structure oe -o bus0.yaml",
            "greybox prbs1.parquet -p drive.yaml -p bus0.yaml --criterion frequency -o bus.yaml --plot p2",
            "validate prbs2.parquet -p bus.yaml -o validate.yaml",
            "spectra sines1.parquet chirp1.parquet -o spectra.yaml --plot p3",
            "compare prbs1.parquet prbs2.parquet --drive drive.yaml --structure oe -o compare.yaml",
            "show rolling.yaml", "show bus.yaml"]},
    "robot": {
        "chain": [
            "spectra chirp_gap.parquet --length 1 -o spectra.yaml --plot p1",
            "blackbox chirp_linear.parquet --drive drive.yaml --structure oe --order 5 -o axis.yaml",
            "greybox chirp_linear.parquet -p axis.yaml --criterion frequency -o frequency.yaml --plot p2",
            "validate low_linear.parquet -p frequency.yaml -o validate.yaml --segment 0.5",
            "simulate high_linear.parquet -p axis.yaml -o simulated.parquet "
            "--condition 'keep from=1 to=2'"]},
    "coast": {
        "chain": [
            "steady plain.parquet --map map.yaml --method coast-down --drive one-body -o plain.yaml --plot p1",
            "steady plain.parquet disc.parquet --map map.yaml --method coast-down --drive one-body "
            "--record disc.parquet motor.added_inertia=5e-5 -o disc.yaml",
            "steady speed.mcap --method coast-down --drive one-body -o speed.yaml",
            "steady run40.parquet --map counts.yaml --method coast-down --drive one-body "
            "--stages 1000:400,400:150 -o stages.yaml",
            "steady run40.parquet run45.parquet --map counts.yaml --method coast-down --drive one-body "
            "--flux-decay 0.05 -o runs.yaml --plot p2",
            "validate run50.parquet run55.parquet --map counts.yaml -p runs.yaml -o validate.yaml --plot p3",
            "validate run50.parquet --map counts.yaml -p runs.yaml -p plain.yaml --criterion coast-down "
            "--flux-decay 0.1",
            "diagnose run40.parquet --map counts.yaml -p runs.yaml --criterion coast-down -o diagnosis.yaml",
            "show disc.yaml", "show validate.yaml"]},
    "site": {
        "chain": [
            "trend summary.parquet -o trends.yaml --plot p1", "trend summary.parquet --json",
            "trend summary.parquet --alarm 3 --strict -o three.yaml", "show trends.yaml"]},
}


def cases() -> list[Case]:
    """The chains, and what is in each recording."""
    found = []
    for folder, chains in CHAINS.items():
        files = {path.name: path for path in sorted((FIXTURES / folder).iterdir())}
        found += [case(f"fixtures-{folder}-{name}", "fixtures", _named(files, chain), tool(chain))
                  for name, chain in chains.items()]
        looks = _looks(files)
        if looks:
            found.append(case(f"fixtures-{folder}-look", "fixtures", files, tool(looks)))
    return found


def _looks(files: dict[str, Path]) -> list[str]:
    """Each recording looked at and converted."""
    found = []
    for name in files:
        stem, _, ending = name.rpartition(".")
        if ending not in ("mcap", "parquet") or stem == "summary":
            continue
        counted = "map.yaml" in files and stem != "speed"
        channels = f" --map {'supply_map' if stem == 'supply' else 'map'}.yaml" if counted else ""
        found += [f"inspect {name}{channels} -o {stem}.{ending}.yaml",
                  f"convert {name}{channels} -o {stem}.{ending}.parquet"]
    return found


def _named(files: dict[str, Path], chain: list[str]) -> dict[str, Path]:
    """The files that a chain names."""
    return {name: path for name, path in files.items() if any(name in command.split() for command in chain)}
