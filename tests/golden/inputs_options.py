"""What needs no recording: help, catalogues, refusals; and which options no case has."""

from __future__ import annotations

import re
import shlex
import subprocess
from collections.abc import Sequence

from tests.golden import environment, places
from tests.golden.case import Case, case, tool

REFUSALS = [
    "drivetool", "drivetool nothing", "drivetool greybox", "drivetool greybox absent.parquet",
    "drivetool greybox start.yaml", "drivetool greybox steps.parquet --parms start.yaml",
    "drivetool greybox steps.parquet -p start.yaml --set motor.inertia=heavy",
    "drivetool greybox steps.parquet -p start.yaml --set engine.inertia=1",
    "drivetool greybox steps.parquet -p start.yaml --criterion best", "drivetool effects nothing",
    "drivetool findings nothing", "drivetool tune -p start.yaml", "drivetool show steps.parquet",
    "drivetool validate steps.parquet -p absent.yaml", "drivetool diagnose steps.parquet -p start.yaml "
    "--candidates nothing", "drivetool backlash steps.parquet -p start.yaml --start fast",
    "drivetool steady steps.parquet --debug -o steady.yaml", "drivetool compare --swap start.yaml",
    "drivetool trend steps.parquet", "drivetool batch absent.yaml", "drivetool init absent"]
START = b"schema: drivetool/parameters/1\nparameters:\n  motor.inertia: {value: 1, unit: kg m^2}\n"


def cases(base: str) -> list[Case]:
    """Help of each command, and so on; the commands are those of BASE."""
    known = commands(base)
    helps = tool(["--help", "-h", "--version", *(f"{name} --help" for name in known)])
    catalogues = []
    for name in ("effects", "findings"):
        catalogues += [f"drivetool {name}", f"drivetool {name} --json"]
        catalogues += [f"drivetool {name} {code}" for code in codes(base, name)]
    steps = places.ROOT / "fixtures" / "rig" / "steps.parquet"
    return [case("help", "help", {}, helps, terminal=True),
            *(case(f"catalogue-{i}", "help", {}, catalogues[i::4]) for i in range(4)),
            case("refusals", "help", {"steps.parquet": steps, "start.yaml": START}, REFUSALS),
            case("debug", "help", {"start.yaml": START}, tool([
                "effects inertia --debug", "findings --json --debug", "show start.yaml --debug"]))]


def printed(base: str, *words: str) -> str:
    """What BASE prints."""
    done = subprocess.run([environment.python(), "-P", "-m", "drivetool", *words], env=environment.variables(base),
                          capture_output=True, text=True, check=True)
    return done.stdout


def commands(base: str) -> list[str]:
    """The commands of BASE, by its help."""
    listed = printed(base, "--help").partition("Commands:")[2]
    return re.findall(r"^  (\w[\w-]*) ", listed, flags=re.MULTILINE)


def codes(base: str, catalogue: str) -> list[str]:
    """The codes of a catalogue of BASE; of the findings every eighth, for the list has all."""
    found = re.findall(r"^- code: (\S+)", printed(base, catalogue), flags=re.MULTILINE)
    return found if catalogue == "effects" else found[::8]


def options(base: str) -> dict[str, list[tuple[str, ...]]]:
    """Command -> its options by all their names."""
    found = {}
    for name in commands(base):
        text = printed(base, name, "--help").partition("Options:")[2]
        lines = re.findall(r"^  (-[\w-]+(?:, --[\w-]+)?)", text, flags=re.MULTILINE)
        found[name] = [tuple(line.split(", ")) for line in lines]
    return found


def uncovered(base: str, cases: Sequence[Case]) -> list[str]:
    """Options, and named values of options, that no command of a case has."""
    used: dict[str, set[str]] = {}
    for each in cases:
        for line in each.commands:
            for part in re.split(r"[|&;]", line):
                try:
                    words = shlex.split(part)
                except ValueError:
                    continue
                if words[:1] == ["drivetool"] and len(words) > 1:
                    used.setdefault(words[1], set()).update(words[2:])
    found = []
    for name, all_names in options(base).items():
        words = used.get(name, set())
        found += [f"{name} {names[-1]}" for names in all_names if not words & set(names)]
        text = " ".join(printed(base, name, "--help").split())
        for option, values in re.findall(r"(--[\w-]+) <(?:list\[)?([a-z0-9|-]+\|[a-z0-9|-]+)\]?>", text):
            found += [f"{name} {option} {value}" for value in values.split("|") if value not in words]
    return found
