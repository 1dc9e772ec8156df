"""The options that several commands share, each defined once."""

from __future__ import annotations

from enum import StrEnum
from typing import Annotated

import typer

# What a fit in time minimises: errors of the motion, or those of the torque.
CriterionName = StrEnum("CriterionName", ("auto", "innovations", "simulation", "inverse"))
# What a fit minimises: errors of the motion in time or frequency, or those of the torque.
FitCriterionName = StrEnum("FitCriterionName", ("auto", "innovations", "simulation", "frequency", "inverse"))
# The same without auto: a black box has one candidate model of a record.
BlackboxCriterionName = StrEnum("BlackboxCriterionName", ("innovations", "simulation", "frequency"))
# What a model is tested by: its motion, the torque that the motion requires, or a coast-down.
CheckCriterionName = StrEnum("CheckCriterionName", ("simulation", "inverse", "coast-down"))
# How a fit in the frequency domain weighs its lines.
WeightingName = StrEnum("WeightingName", ("variance", "coherence"))
# The part of a recording from which the friction is identified.
MethodName = StrEnum("MethodName", ("speeds", "acceleration", "coast-down"))
# Polynomial structures of the black box.
StructureName = StrEnum("StructureName", ("oe", "bj", "arx", "armax", "innovations"))

Logs = Annotated[list[str], typer.Argument(metavar="LOG", help="Recordings, Parquet or MCAP, or folders of them.")]
Log = Annotated[str, typer.Argument(metavar="LOG", help="A recording, Parquet or MCAP, or the folder of one.")]
Params = Annotated[list[str] | None, typer.Option(
    "--params", "-p", metavar="FILE",
    help="Parameter file of an earlier step or by hand; several merge, later wins; - reads standard input.")]
Models = Annotated[list[str], typer.Option(
    "--params", "-p", metavar="FILE", help="A model to check, as a parameter file; several are compared.")]
Base = Annotated[list[str], typer.Option(
    "--params", "-p", metavar="FILE", help="The fitted drive; several files merge, later wins.")]
Map = Annotated[str | None, typer.Option(
    "--map", "-m", metavar="FILE", help="Channel map: which channel plays which role, in which unit.")]
Condition = Annotated[list[str] | None, typer.Option(
    "--condition", metavar="STEP", help="Done to every recording first: 'keep from=2 to=8' and "
    "'omit from=4.5 to=5' (seconds) before any check, then in the order given despike, 'lowpass cutoff=50', "
    "detrend, 'decimate factor=5', differentiate, integrate; repeatable.")]
DriveName = Annotated[str | None, typer.Option(
    "--drive", metavar="NAME|FILE",
    help="one-body, two-mass, three-mass, vehicle, or a YAML file with a drive section. "
         "Default: as in the parameter file, else two-mass.")]
Hold = Annotated[list[str] | None, typer.Option(
    "--hold", metavar="NAME", help="Keep this parameter at its value; repeatable.")]
Free = Annotated[list[str] | None, typer.Option(
    "--free", metavar="NAME", help="Fit this parameter although it would be held; repeatable. "
    "'all': whatever a grey-box fit frees.")]
Set = Annotated[list[str] | None, typer.Option(
    "--set", metavar="NAME=VALUE", help="Start value, with unit if not the drive's own: "
    "'shaft.half_gap=2 mrad'; repeatable.")]
Start = Annotated[list[str] | None, typer.Option(
    "--start", metavar="rest|STATE=VALUE", help="Known state in which every recording begins, so that it is not "
    "fitted: 'rest' for standstill, BODY.speed=VALUE, SHAFT.twist=VALUE, or the angle of the first body, as in "
    "'motor.angle=90 deg'; repeatable.")]
Record = Annotated[list[str] | None, typer.Option(
    "--record", metavar="FILE WORD", help="What differs in one of the recordings, named as on this command line: "
    "NAME=VALUE, known; free=NAME,NAME, fitted anew; start=rest, start=STATE=VALUE or start=free; repeatable.")]
Method = Annotated[MethodName, typer.Option(
    "--method", help="speeds: friction from intervals of constant speed; acceleration: mass and friction from "
    "intervals of constant torque, up and coasting; coast-down: ratios of friction and inertia from running down "
    "without torque, both where a torque is known.")]
FluxDecay = Annotated[float | None, typer.Option(
    "--flux-decay", metavar="S", min=0.0, help="coast-down: time in s after switching off that is left out, until "
    "the flux of an induction motor has decayed. Default: 0; validate: what the fit left out.")]
Stages = Annotated[str | None, typer.Option(
    "--stages", metavar="HIGH:LOW,...", help="coast-down: fit windows of the speed one after the other, in rpm, or "
    "with the unit behind the last: '1600:750,750:300'. Viscous friction and inertia by the first, Coulomb "
    "friction by the second, speeds of breakaway by a third. The bias against the fit of all at once is stated.")]
Segment = Annotated[float | None, typer.Option(
    "--segment", metavar="S", min=0.0,
    help="Length in s of segments with free start states for a simulation fit; 0: one free run.")]
FreeRun = Annotated[float, typer.Option(
    "--segment", metavar="S", min=0.0,
    help="Length in s of the free runs, each with start states of its own; 0: one free run.")]
Starts = Annotated[int | None, typer.Option(
    "--starts", metavar="N", min=1, help="Starting points to try. Default: the step decides.")]
Seed = Annotated[int, typer.Option("--seed", metavar="N", min=0, help="Of everything random.")]
Out = Annotated[str | None, typer.Option(
    "--out", "-o", metavar="FILE", help="Where the YAML goes, its folder made if it is missing; - is standard "
    "output, the default on a pipe.")]
Json = Annotated[bool, typer.Option("--json", help="The same content as JSON on standard output.")]
Plot = Annotated[str | None, typer.Option(
    "--plot", metavar="DIR", help="Draw pictures into this folder, also when the fit failed.")]
Strict = Annotated[bool, typer.Option("--strict", help="Warnings count as failures (exit code 3).")]
Debug = Annotated[bool, typer.Option("--debug", help="Show the traceback of an error.")]
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="Nothing on standard error but errors.")]
MinFit = Annotated[float | None, typer.Option(
    "--min-fit", metavar="PERCENT", max=100.0,
    help="Least simulation fit, else that of a constant; missed: exit code 3.")]
MaxCorrelation = Annotated[float, typer.Option(
    "--max-correlation", metavar="R", min=0.0, max=1.0,
    help="Largest cross-correlation of residual and input; missed: exit code 3.")]
Structure = Annotated[StructureName | None, typer.Option(
    "--structure", help="A polynomial model in discrete time instead of the third-order one in continuous time.")]
Order = Annotated[int | None, typer.Option(
    "--order", metavar="N", min=1, help="Order of its dynamics, 2 n - 1 for n bodies. Default: by held-out score.")]
NoiseOrder = Annotated[int | None, typer.Option(
    "--noise-order", metavar="N", min=0, help="Order of its noise model (bj, armax). Default: 2.")]
Criterion = Annotated[CriterionName, typer.Option(
    "--criterion", help="What the fit minimises: one-step prediction with its noise model, simulation, or inverse: "
    "the torque that the motion asks for; auto tries several explanations of the record.")]
FitCriterion = Annotated[FitCriterionName, typer.Option(
    "--criterion", help="What the fit minimises: one-step prediction with its noise model, simulation, the "
    "distance from the measured frequency response, or inverse: the torque that the motion asks for; auto fits "
    "several explanations of the record and lets free runs choose.")]
BlackboxCriterion = Annotated[BlackboxCriterionName, typer.Option(
    "--criterion", help="What the fit minimises: one-step prediction with its noise model, simulation, or the "
    "distance from the measured frequency response.")]
CheckCriterion = Annotated[CheckCriterionName, typer.Option(
    "--criterion", help="What a model is judged by: the motion that it simulates; inverse: the torque that the "
    "motion asks of it; coast-down: run-downs without torque, taken by itself where the file is of one.")]
Weighting = Annotated[WeightingName, typer.Option(
    "--weighting", help="Of the lines of a frequency fit: by their variance (maximum likelihood), or by coherence "
    "over frequency, of logarithms.")]
Band = Annotated[tuple[float, float] | None, typer.Option(
    "--band", metavar="LOW HIGH", help="Hz; lines outside are left out.")]
