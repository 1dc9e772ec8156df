"""Codes about validation, replays and diagnoses."""

from drivetool.finding_codes.code import FAILURE, NOTE, WARNING, Code

CODES = {
    "biased-base": Code(
        WARNING,
        "The base of a diagnosis may be biased, and the bias be taken for a cause. It was fitted to other "
        "recordings, by `--criterion inverse` where the motion was imposed, or with a torque that is logged a "
        "sample late or early.",
        "Fit the base to these recordings with `greybox`, by a simulation, with the stated `shift` in the channel "
        "map; or run `diagnose --criterion inverse`."),
    "coast-down-not-explained": Code(
        WARNING,
        "The error of a simulated coast-down is larger than the counts of its encoder and the uncertainty of the "
        "model explain. The friction of this drive has changed, or follows another law.",
        "Fit this record too with `steady --method coast-down`, alone and together with the first."),
    "diagnosis-named": Code(
        NOTE,
        "The diagnosis identifies one or more causes: effects that the model lacks, or faults of the record. They "
        "improve the prediction of held-out data, and no other candidate does as well.",
        "Act on the stated causes; go on with the extended drive that the file holds."),
    "diagnosis-nothing-found": Code(
        NOTE,
        "The residual holds nothing beyond noise that an effect of the catalogue explains.",
        "Nothing. A smaller effect needs the stated experiment."),
    "diagnosis-undetermined": Code(
        WARNING,
        "Several causes explain the record equally well, or a cause helps but leaves doubt that an effect outside "
        "the catalogue is at work.",
        "Do the stated experiment, which distinguishes the causes."),
    "diagnosis-unexplained": Code(
        WARNING,
        "The model lacks something, but no effect of the catalogue explains the residual.",
        "Do the stated experiment; look at the pictures of the residual.",
        says="doubt"),
    "encoder-quantisation": Code(
        NOTE,
        "The quantisation of an encoder makes up at least a tenth of the noise variance of an angle. The motion "
        "covers many steps between samples, so it acts as white noise.",
        "Use a finer encoder if smaller effects matter."),
    "explains-nothing": Code(
        FAILURE,
        "The simulation of the whole record fits worse than the mean of the measured signal. The model is wrong, "
        "or noise has led a long free run away from the record. From `greybox`: free runs of one second have "
        "errors as large as straight lines through the speed. Or their errors over held-out parts are more than "
        "half as large. Then no intervals are given.",
        "Run `diagnose`, or validate by shorter free runs with `--segment`. After `greybox`, check channels, "
        "units and signs."),
    "extrapolation": Code(
        WARNING,
        "The torque or speed of the validation record exceeds the range of the fitted records by more than a "
        "tenth. The model extrapolates there.",
        "Fit on a recording with this range too, if the machine works there."),
    "free-run-noise-limited": Code(
        NOTE,
        "Under the estimated torque noise even a true model cannot reproduce this free run, as across a backlash "
        "gap. The simulation fit is within what simulations with other noise reach.",
        "Judge the model by its residual, or by shorter free runs: `--segment 1`."),
    "held-out-own-values": Code(
        NOTE,
        "A diagnosis by the required torque used held-out records that have a parameter of their own (--record "
        "FILE free=NAME). That parameter was fitted to them, with all other values held.",
        "Read the gain as that of a drive whose named parameter is known for each record."),
    "limit-missed": Code(
        FAILURE,
        "The validation misses a limit: the fit of the simulated output is below `--min-fit`, or the "
        "cross-correlation of residual and torque exceeds `--max-correlation`. The latter says that the model "
        "lacks something that depends on the input, unless the record is so short that chance explains it.",
        "Look at the pictures of `--plot`, then run `diagnose`, or record longer."),
    "narrow-band-disturbance": Code(
        NOTE,
        "The one-step prediction errors hold a narrow-band disturbance at a fixed frequency, whatever the speed: "
        "mains, a fan, or a structural resonance that the model lacks.",
        "Look for it in a record at standstill, with the power stage on and off."),
    "not-held-out": Code(
        WARNING,
        "The record was used for the fit of the model. It is no validation, and a gain stated on it is biased.",
        "Validate on a recording that no fit has used."),
    "outliers": Code(
        WARNING,
        "Single samples of a sensor lie far from their neighbours or from what the model predicts. They are left "
        "out.",
        "Check the cable and the connector of the sensor."),
    "parameters-change": Code(
        WARNING,
        "One part of the data has other parameter values than another: the second half of the records, or a "
        "held-out record against those of the fit. The log likelihood rises clearly when the stated parameters "
        "change, by more than their uncertainty explains. The drive changes with temperature or wear, or a law is "
        "missing that the parts excite differently.",
        "Fit the parts by themselves to see which parameter changes; record after warming up, and hold out a "
        "record that was made under the same conditions."),
    "quantisation": Code(
        NOTE,
        "The steps in which a sensor is logged make up at least a tenth of its noise variance. In slow motion "
        "this error is correlated, and fits can take it for physics.",
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
        "friction is biased, or the inertia is wrong under a torque of one direction.",
        "Check friction and idle torque with `steady`, and whether the load was the same."),
    "speed-filter": Code(
        NOTE,
        "The logged motor speed is later than the rate of the logged motor angle, as behind a low-pass filter. "
        "The diagnosis counts it as a cause.",
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
