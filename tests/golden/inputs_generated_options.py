"""Chains that have each option of the commands that fit or check, on generated recordings."""

from __future__ import annotations

START = "-p start.yaml"
BLACK = "blackbox record1.parquet"
GREY = f"greybox record1.parquet {START} -o fit.yaml"
GAP = "backlash record1.parquet -p start.yaml -o gap.yaml --set 'shaft.half_gap=0.2 mrad'"
TWO = "record1.parquet record2.parquet"
SHOW = "show fit.yaml"
MORE = {"records": 2}
# Conditions in each form; an angle is made of a speed and a speed of an angle.
STEPS = ("despike", "'lowpass cutoff=100'", "detrend", "'decimate factor=2'", "'omit from=1 to=1.2'")

# Name -> (hidden effects, bodies, commands, further arguments of the machine).
OPTIONS: dict[str, tuple] = {
    **{f"blackbox-{name}": ("", 2, [f"{BLACK} --drive two-mass --structure {name} -o fit.yaml --plot p1", SHOW])
       for name in ("oe", "bj", "arx", "armax", "innovations")},
    **{f"blackbox-{name}": ("", 2, [f"{BLACK} {START} {words} -o fit.yaml", SHOW]) for name, words in {
        "innovations-fit": "--criterion innovations", "simulation": "--criterion simulation",
        "frequency": "--criterion frequency --structure oe"}.items()},
    "blackbox-three": ("", 3, [f"{BLACK} --drive three-mass --structure oe --order 5 -o fit.yaml", SHOW]),
    "blackbox-one": ("", 1, [f"{BLACK} --drive one-body --structure arx --order 1 --json", f"{BLACK} -o two.yaml"]),
    "blackbox-options": ("", 2, [
        f"{BLACK} {START} --structure bj --order 3 --noise-order 1 -o fit.yaml --strict",
        f"{BLACK} {START} --seed 2",
        f"{BLACK} {START} --structure oe --criterion frequency --weighting coherence --band 2 100 -q --json "
        "--debug",
        f"{BLACK} {START} --structure oe --criterion frequency --weighting variance --band 2 100 -o variance.yaml",
        f"{BLACK} {START} --criterion simulation --segment 1 --starts 2 --hold total.idle_torque "
        "--set load.inertia=1 --free total.viscous --condition 'keep from=0.5 to=2.5' -o held.yaml", SHOW]),
    "greybox-options": ("coulomb-motor", 2, [
        f"{GREY} --criterion simulation --segment 1 --starts 2 --seed 5 --hold shaft.damping "
        "--free motor.coulomb --set 'motor.inertia=1 kg m^2' --strict -q",
        f"greybox record1.parquet {START} --criterion frequency --weighting variance --band 1 100 --json "
        "--debug --plot p1",
        f"greybox record1.parquet {START} --criterion frequency --weighting coherence -o coherence.yaml",
        f"greybox record1.parquet {START} --drive two-mass --criterion innovations"]),
    "greybox-start": ("", 2, [f"{GREY} --start motor.speed=0 --start 'shaft.twist=0 mrad'",
                              f"greybox record1.parquet {START} --start rest -o rest.yaml"]),
    "greybox-records": ("", 1, [
        f"greybox {TWO} {START} -o fit.yaml --record record2.parquet free=motor.viscous",
        f"greybox {TWO} {START} -o added.yaml --record record2.parquet motor.added_inertia=0.1 "
        "--record record1.parquet start=rest", f"validate {TWO} holdout.parquet -p fit.yaml "
        "--record record2.parquet start=free -o validate.yaml", SHOW], MORE),
    "greybox-clamped": ("", 2, [f"{GREY} --record record1.parquet clamped=load"]),
    "greybox-constant": ("", 1, [
        f"greybox record1.parquet {START} -m map.yaml --set 'motor.torque_constant=350 mNm/A' -o fit.yaml",
        "inspect record1.parquet -m map.yaml -q --strict --debug"]),
    "greybox-three-mass": ("third-mass", 2, [
        "greybox record1.parquet --drive three-mass --set motor.inertia=1 --set gear.inertia=1 "
        "--set arm.inertia=0.5 --set shaft.stiffness=5000 --set shaft2.stiffness=20000 -o fit.yaml", SHOW]),
    **{f"condition-{i}": ("", 2, [f"{GREY} --condition {word}"]) for i, word in enumerate(STEPS)},
    "condition-differentiate": ("", 2, [f"{GREY} --condition differentiate"], {"sensors": ("motor_angle",)}),
    "condition-integrate": ("", 2, [f"{GREY} --condition integrate"]),
    **{f"backlash-{name}": ("backlash", 2, [f"{GAP} --criterion {name}{words}", "show gap.yaml"])
       for name, words in {"auto": "", "innovations": " --start rest", "simulation": " --segment 0.5 --free all",
                           "inverse": " --hold total.viscous"}.items()},
    "backlash-options": ("backlash", 2, [
        f"{GAP} -m map.yaml --criterion innovations",
        f"{GAP} --starts 2 --seed 4 --drive two-mass --condition 'keep from=0 to=2.5' --strict -q --debug",
        f"backlash {TWO} {START} --record record2.parquet start=free --json --plot p1"], MORE),
    "steady": ("coulomb-motor", 1, [
        f"steady {TWO} --drive one-body -o steady.yaml --method speeds --plot p1 --strict",
        f"steady record1.parquet {START} --hold motor.viscous --free motor.coulomb --set motor.inertia=1 "
        "--criterion auto --condition 'keep from=0 to=2' -q --json",
        f"steady record1.parquet {START} --free motor.drag -o fan.yaml",
        f"steady record1.parquet {START} --seed 2", f"steady record1.parquet {START} --starts 1",
        f"steady record1.parquet {START} --method acceleration -o acceleration.yaml",
        "steady record1.parquet --drive one-body --method coast-down --debug -o down.yaml",
        f"steady record1.parquet {START} --record record1.parquet start=free",
        *(f"steady record1.parquet {START} --criterion {name} --segment 1 -o {name}.yaml"
          for name in ("innovations", "simulation", "inverse"))],
        {"record": "cruise", "records": 2}),
    "steady-moves": ("", 2, ["steady record1.parquet -o steady.yaml --drive two-mass"], {"record": "moves"}),
    **{f"spectra-{name}": ("", 2, [f"spectra record1.parquet --estimator {name} --length 0.5 -o s.yaml "
                                   "--plot p1", "show s.yaml"])
       for name in ("h1", "h2", "h3", "hv")},
    "spectra-options": ("", 2, [
        "spectra record1.parquet --estimator indirect --json -q",
        "spectra record1.parquet --method welch --window hamming --length 1 --overlap 0.25 --band 1 100 "
        "--curves curves.parquet --output load_speed --strict",
        "spectra record1.parquet --method periodic --period 0.5 --skip 1 --debug -o p.yaml",
        "spectra record1.parquet record2.parquet --method auto --condition detrend -o s.yaml"],
        {"records": 2, "sensors": ("motor_speed", "load_speed")}),
    "compare-structures": ("", 2, [
        f"compare {TWO} {START} -o compare.yaml --plot p1 "
        + " ".join(f"--structure {name}" for name in ("oe", "bj", "arx", "armax", "innovations")),
        "show compare.yaml"], MORE),
    "compare-physical": ("", 2, [
        f"compare {TWO} {START} --structure physical --structure physical-innovations --json -q"], MORE),
    "compare-options": ("", 1, [
        f"compare {TWO} record3.parquet record4.parquet {START} --machine 'A=record[12].parquet' "
        "--machine 'B=record[34].parquet' --order 1 "
        "--noise-order 1 --drive one-body -m map.yaml --set motor.viscous=0.1 --condition detrend --strict --debug "
        "-o compare.yaml"], {"records": 4}),
    "compare-swap": ("", 2, [
        "blackbox record1.parquet --drive two-mass -o one.yaml",
        "blackbox record2.parquet --drive two-mass -o two.yaml",
        "compare --swap one.yaml two.yaml -o swap.yaml", "compare --swap one.yaml two.yaml --json",
        "show swap.yaml"], MORE),
    "validate-options": ("", 2, [
        f"validate record1.parquet {START} --min-fit 50 --max-correlation 0.5 --criterion simulation "
        "--condition 'keep from=0 to=2' --seed 2 -m map.yaml --plot p1 -o v.yaml",
        f"validate record1.parquet {START} --criterion inverse --drive two-mass -q --strict --debug --json",
        f"validate record1.parquet {START} --start rest --min-fit 99.99"]),
    "simulate-options": ("", 2, [
        f"simulate record1.parquet {START} -o s.parquet --segment 0.5 --set load.inertia=2 --strict "
        "--condition 'keep from=0.5 to=2' -m map.yaml",
        f"simulate record1.parquet {START} -o r.parquet --start rest --drive two-mass -q --debug --plot p1"]),
    "convert-options": ("", 2, [
        "convert record1.parquet -m map.yaml -o c.parquet --strict -q --debug",
        "inspect c.parquet"]),
    "damaged": ("", 2, [line for name in ("gap", "lost", "jitter", "short", "cut") for line in (
        f"inspect {name}.parquet -o {name}.inspect.yaml",
        f"greybox {name}.parquet {START} -o {name}.yaml")]),
    "parts-beside-totals": ("", 2, [f"{GREY} --free motor.viscous --free load.viscous", SHOW]),
}
