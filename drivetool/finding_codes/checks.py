"""Codes about validation, replays and diagnoses."""

from drivetool.finding_codes.code import FAILURE, NOTE, WARNING, Code

CODES = {
    "biased-base": Code(
        WARNING,
        "The base of a diagnosis may be biased, and the diagnosis may report the bias as a cause. The base was "
        "fitted to other recordings, or to the torque of an imposed motion (`--criterion inverse`), or with a "
        "torque logged one sample late or early.",
        "Fit the base to these recordings with `greybox`, by a simulation, with the stated `shift` in the channel "
        "map; or run `diagnose --criterion inverse`."),
    "coast-down-not-explained": Code(
        WARNING,
        "The error of a simulated coast-down exceeds what encoder quantisation and the uncertainty of the model "
        "explain. The friction of this drive has changed, or follows another law.",
        "Fit this record too with `steady --method coast-down`, alone and together with the first."),
    "diagnosis-named": Code(
        NOTE,
        "The diagnosis identifies one or more causes: effects that the model lacks, or faults of the record. They "
        "improve the prediction of held-out data, and no other candidate does as well.",
        "Act on the stated causes; continue with the extended drive in the output file."),
    "diagnosis-nothing-found": Code(
        NOTE,
        "No effect of the catalogue explains more of the residual than chance does.",
        "Nothing. A smaller effect needs the stated experiment."),
    "diagnosis-undetermined": Code(
        WARNING,
        "Several causes explain the record equally well, or a cause lowers the error, but an effect outside the "
        "catalogue may act instead or too.",
        "Do the stated experiment, which distinguishes the causes."),
    "diagnosis-unexplained": Code(
        WARNING,
        "The model lacks something, but no effect of the catalogue explains the residual.",
        "Do the stated experiment; look at the pictures of the residual.",
        says="doubt"),
    "encoder-quantisation": Code(
        NOTE,
        "The quantisation of an encoder makes up at least a tenth of the noise variance of an angle. The motion "
        "covers many steps between samples, so the quantisation error acts as white noise.",
        "Use a finer encoder if smaller effects matter."),
    "explains-nothing": Code(
        FAILURE,
        "The simulation of the whole record fits worse than the mean of the measured signal. The model is wrong, "
        "or noise makes a long free run diverge from the record. `greybox` reports it where free runs of one "
        "second have errors as large as those of straight lines fitted to the speed. It also reports errors more "
        "than half as large as those of such lines on held-out parts. Then no intervals are given.",
        "Run `diagnose`, or validate by shorter free runs with `--segment`. After `greybox`, check channels, "
        "units and signs."),
    "extrapolation": Code(
        WARNING,
        "The torque or speed of the validation record exceeds the range of the fitted records by more than a "
        "tenth. The model extrapolates there.",
        "Fit on a recording with this range too, if the machine works there."),
    "free-run-noise-limited": Code(
        NOTE,
        "The estimated torque noise limits this free run: even a true model cannot reproduce it, for example where "
        "the drive has backlash. The simulation fit is within the range of simulations with other realisations of "
        "the noise.",
        "Assess the model by its residual, or by shorter free runs: `--segment 1`."),
    "free-run-not-explained": Code(
        WARNING,
        "A free run has a lower fit than noise and the uncertainty of the parameters leave to a true model: less "
        "than all of 100 simulations with other noise and other values. A fit reports it of a speed where a free "
        "run over the whole record fits worse than the mean; `validate` of a fit below 50 %, which is then not "
        "passed.",
        "Run `diagnose`: the model lacks a law, or a load torque that was not logged acts."),
    "held-out-own-values": Code(
        NOTE,
        "With `--criterion inverse`, the held-out records have a parameter of their own (--record FILE free=NAME). "
        "That parameter was fitted to them, with all other values held.",
        "The stated gain is conditional: it assumes that this parameter is known for each record."),
    "limit-missed": Code(
        FAILURE,
        "The validation misses a limit: the fit of the simulated output is below `--min-fit`, or the "
        "cross-correlation of residual and torque exceeds `--max-correlation`. The latter indicates unmodelled "
        "dynamics driven by the input, unless the record is so short that such a correlation occurs by chance.",
        "Look at the pictures of `--plot`, then run `diagnose`, or record longer."),
    "narrow-band-disturbance": Code(
        NOTE,
        "The one-step prediction errors hold a narrow-band disturbance at a fixed frequency, whatever the speed: "
        "mains, a fan, or a structural resonance that the model lacks.",
        "Look for it in a record at standstill, with the power stage on and off."),
    "not-held-out": Code(
        WARNING,
        "The record was used for the fit of the model. This is not a validation, and a gain computed on it is "
        "biased.",
        "Validate on a recording that no fit has used."),
    "outliers": Code(
        WARNING,
        "In a diagnosis, single samples of a sensor lie far from their neighbours or from the one-step prediction. "
        "They are left out.",
        "Check the cable and the connector of the sensor."),
    "parameters-change": Code(
        WARNING,
        "One part of the data has other parameter values than another: the second half of the records, or a "
        "held-out record compared with the fitted records. The log likelihood rises clearly when the stated "
        "parameters change, by more than their uncertainty explains. The drive changes with temperature or wear, "
        "or an unmodelled effect is excited differently in the parts.",
        "Fit each part separately to find the parameter that changes; record after warming up, and hold out a "
        "record that was made under the same conditions."),
    "quantisation": Code(
        NOTE,
        "The steps in which a sensor is logged make up at least a tenth of its noise variance. In slow motion "
        "this error is correlated, and a fit can mistake it for a physical effect.",
        "Log the sensor with more digits or from a finer sensor; for a speed, log the angle."),
    "ranking-depends-on-start": Code(
        NOTE,
        "One model has the least simulation error with a fitted start state, another one from the measured start "
        "state. A fitted start state can compensate for errors of a model.",
        "Compare shorter free runs with `--segment`, or state a known start with `--start`."),
    "residual-depends-on-input": Code(
        WARNING,
        "The residual of the simulation depends on the torque, at a family-wise significance of 1 %. The model "
        "lacks an effect, or a parameter is biased.",
        "Run `diagnose`."),
    "shaft-torque-unchecked": Code(
        NOTE,
        "Sign and scale of the shaft torque sensor could not be checked: the fit to the motor alone does not "
        "determine the torque in the shaft.",
        "Record torque steps that excite the resonance."),
    "simulation-drifts": Code(
        WARNING,
        "The error of a simulated speed is mostly a ramp, steeper than the noise explains. An idle torque or a "
        "friction is biased, or the inertia is biased and the torque does not change sign.",
        "Check friction and idle torque with `steady`, and whether the load was the same as in the fitted "
        "recording."),
    "speed-filter": Code(
        NOTE,
        "The logged motor speed lags the derivative of the logged motor angle, as if low-pass filtered. The "
        "diagnosis reports it as the cause `speed-filter`.",
        "Log the speed before its filter, or use the angle."),
    "tuned-for-another-file": Code(
        NOTE,
        "The gains that are replayed were tuned for another parameter file, or for an earlier state of this one.",
        "Tune again if the parameters have changed."),
    "wrong-scale": Code(
        WARNING,
        "Two channels that measure the same motion or torque differ by a factor. A unit, a scale or a gear ratio "
        "is wrong; the diagnosis corrects the channel for the rest of its work.",
        "Correct unit or scale in the channel map, or the gear ratio of the drive."),
    "wrong-sign": Code(
        WARNING,
        "Two channels that measure the same motion or torque have opposite signs. The diagnosis corrects the sign "
        "for the rest of its work.",
        "Set `sign: -1` for the stated channel in the channel map."),
}
