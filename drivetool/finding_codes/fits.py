"""Codes about identification: spectra, black-box, grey-box and backlash fits."""

from drivetool.finding_codes.code import NOTE, NOTE_OR_FAILURE, NOTE_OR_WARNING, WARNING, WARNING_OR_FAILURE, Code

CODES = {
    "direction-changes": Code(
        WARNING,
        "The motor reverses in the record. Coulomb friction then changes its sign, and the linear black-box model "
        "does not describe it.",
        "Use a record of one direction, or go on to `greybox`."),
    "distortion-not-separable": Code(
        NOTE,
        "The periodic excitation fills every spectral line of its band. Nonlinear distortion repeats with the "
        "period too, and cannot be separated from the linear response.",
        "Excite odd lines only and leave some of them out, or record several runs with other phases."),
    "excitation-gaps": Code(
        NOTE,
        "The excitation leaves gaps between its spectral lines. The frequency response is not known in them.",
        "Excite the missing spectral lines if a resonance may lie there."),
    "friction-from-prior": Code(
        NOTE,
        "The shaft torque was measured, and this record determines the friction of a body with a standard "
        "deviation above a third of its value. The value of the parameter file (the prior) is kept, and its "
        "covariance is propagated.",
        "Record steps about speeds that differ more, or name the parameter with `--free`."),
    "gap-ambiguous": Code(
        WARNING,
        "Starts of the multi-start fit end at clearly different half gaps with equal likelihood. The half gap "
        "gets no interval.",
        "Record torque steps that cross the gap both ways."),
    "gap-law": Code(
        NOTE,
        "The published laws of a gap were fitted: the damping is part of the contact (`inside`), acts in contact "
        "and in the gap (`always`), or is part of the contact and the shaft relaxes in the gap (`contact`). One is "
        "chosen where its log likelihood is higher by more than 7 than that of any other, and the file states it "
        "as `damping_law`. Otherwise the law of the parameter file is used if it is among those that tie, else the "
        "likeliest; the `evidence` of the finding lists the values by each law.",
        "Keep `damping_law` in the parameter file. Where none is significantly likelier, record more passages "
        "through the gap, slow ones too."),
    "gap-left-out": Code(
        WARNING,
        "The model of two masses lacks a backlash gap. With a gap, the log likelihood rises by more than 12 under "
        "the same noise models. All fits without the gap are biased. The shaft and the two inertias get no "
        "interval.",
        "Fit it too with `--free shaft.half_gap`; if there is no gap, state it with `--set shaft.half_gap=0`."),
    "gap-may-open": Code(
        WARNING,
        "The shaft torque changes its sign in the record. A backlash gap, if there is one, opens there, and the "
        "fitted model has none. `greybox` reports it where it cannot test for a gap: the drive has several "
        "shafts, or the stiffness is held.",
        "Use torque steps upward from a constant speed; if there is no gap, state it with `--set "
        "shaft.half_gap=0`."),
    "gap-not-crossed": Code(
        WARNING,
        "The gap opens in the record but its other side is never reached. The record gives only a lower bound of "
        "the half gap.",
        "Record torque steps of both signs."),
    "gap-not-opened": Code(
        WARNING,
        "The shaft torque never changes its sign, so the record does not open the gap. The half gap is not "
        "identifiable.",
        "Record alternating torque steps larger than the idle torque."),
    "gap-not-significant": Code(
        NOTE,
        "The profile likelihood of the half gap includes zero. There is an upper limit and no lower one.",
        "Record smaller torque steps around zero shaft torque to identify a smaller gap."),
    "gap-refit": Code(
        NOTE,
        "Errors of a few per cent in the linear parameters bias the half gap. This holds where the load inertia "
        "is low compared with the motor, or a measured shaft torque has many passages through the gap. These "
        "parameters are fitted jointly with the gap.",
        "Use `--hold` for values that are known for certain."),
    "gap-unbounded": Code(
        WARNING,
        "The profile likelihood of the half gap is flat towards large values. There is a lower limit and no upper "
        "one.",
        "Record torque steps that cross the gap both ways."),
    "held-value-rejected": Code(
        WARNING,
        "The record rejects a held value or the stated start state, and the fitted parameters compensate for it. "
        "Freeing the value alone raises the log likelihood by more than 30, changes the value by more than 1 %, "
        "and leaves no correlated innovations. Or the first samples contradict a start state by more than 8 "
        "standard deviations. `greybox` tests the dead time, the half gaps and the parameters given with "
        "`--hold`, unless they are zero. It does so only where another finding states that the model lacks an "
        "effect.",
        "Fit it too with `--free`, or correct it with `--set`; leave `--start` out, or begin where the drive "
        "rests: `--condition 'keep from=SECONDS'`."),
    "held-values-dominate": Code(
        NOTE,
        "The uncertainty of held values, propagated from the parameter file, contributes more than twice the "
        "fit's own uncertainty to the stated interval.",
        "Free the held parameters with `--free`, if this record determines them better."),
    "inconsistent-with-prior": Code(
        WARNING,
        "A parameter lies more than 8 combined standard deviations from its value in the parameter file: the "
        "estimate is inconsistent with its prior. Either this fit or the one behind the parameter file lacks an "
        "effect.",
        "Run `diagnose` on both recordings."),
    "innovations-correlated": Code(
        NOTE_OR_WARNING,
        "The one-step prediction errors (innovations) are correlated: the model lacks an effect. Intervals are "
        "conditional on its structure. It is a note where quantisation explains the correlation.",
        "Run `validate`, then `diagnose`.",
        says="doubt"),
    "input-delay": Code(
        WARNING,
        "The model is far likelier if the torque acts later than it was logged, by a lag or by a part of a "
        "sample. The converter has a lag or a dead time, or the speed is filtered; a `shift` of whole samples "
        "does not correct it.",
        "Free `converter.bandwidth` or `converter.dead_time`, or set `sensor.bandwidth`."),
    "low-coherence": Code(
        WARNING_OR_FAILURE,
        "The coherence of torque and output is below 0.5 at more than a tenth of the spectral lines; there the "
        "frequency response is unreliable. It is a failure where it is below 0.5 at every line: the estimate "
        "describes noise.",
        "Use the other lines only; check the channels and their clocks, excite more, or record longer. Use longer "
        "frames for sharp resonances."),
    "low-inertia-ratio": Code(
        WARNING,
        "The load has less than a fifth of the motor's inertia and only the motor is measured. The half gap is "
        "biased by small errors of held parameters, so it gets no interval.",
        "Log the shaft torque or the load speed, or pass the parameter file of a `greybox` step."),
    "mass-left-out": Code(
        WARNING,
        "The model of two masses lacks a third. With the load split by one more shaft, the log likelihood rises "
        "by more than 12 and the innovations are no longer correlated. All fits without the third mass are "
        "biased. The shaft and the two inertias get no interval.",
        "Fit it too with `--drive three-mass`, or run `diagnose`. A sensor at the load identifies it best."),
    "model-error": Code(
        WARNING,
        "The drive model has a structural error, which a noise model would hide. In drives without a gap, an "
        "unmodelled effect (a function of the motion) accounts for more than 1 % of the torque, and the text "
        "names it. Or free runs reject the likeliest noise model, or credible models of the record disagree by "
        "more than their noise. For all other drives, a simulation-error fit reproduces the held-out end of the "
        "record clearly better than a fit of one-step prediction errors.",
        "Run `diagnose`. The intervals of the default fit include the disagreement as `std_structure`; all other "
        "intervals are conditional on the structure.",
        says="doubt"),
    "model-order": Code(
        NOTE_OR_WARNING,
        "Cross-validation over the order of a polynomial model chooses the stated number of bodies. It is a "
        "warning where the drive has another number. Or a pole and a zero cancel within their uncertainty "
        "(warning): the order is higher than the records support.",
        "Use a drive with that many bodies, or give `--order` to keep this one; where poles and zeros cancel, "
        "lower it."),
    "no-conversion": Code(
        NOTE_OR_FAILURE,
        "The black-box model has no equivalent chain of masses: its order, or its zeros and poles, do not fit the "
        "drive. No inertias and stiffnesses are given. It is a failure where an inertia or a stiffness is "
        "estimated as negative or beyond its bound.",
        "Choose `--order` 2 n - 1 for n bodies, or another `--drive`. After a failure check signs and units of "
        "torque and speed in the channel map, and excite the resonance."),
    "no-fit": Code(
        WARNING,
        "A structure of the comparison could not be fitted to a record, for the stated reason. It is missing in "
        "the tables.",
        "Leave it out, or change the order."),
    "nonlinear-distortion": Code(
        NOTE_OR_WARNING,
        "The drive is not linear: the output has power on even or odd spectral lines that are not excited. It is a "
        "warning above -40 dB relative to the signal.",
        "Even lines point to friction that depends on the direction, or a gap loaded on one side; odd lines to "
        "Coulomb friction or backlash. Compare amplitudes; the linear model holds at one only."),
    "not-converged": Code(
        WARNING,
        "The fit did not converge: the likelihood still rose when it stopped, or no second start of the "
        "multi-start fit reached the same optimum. Or a model with a rigid shaft has a higher likelihood (local "
        "optimum). No intervals are given.",
        "Give better start values with `--set`, hold what is known with `--hold`, or use a record with more "
        "excitation."),
    "not-identifiable": Code(
        NOTE_OR_WARNING,
        "The record does not determine a parameter: it has no effect on the outputs, or only a combination with "
        "other parameters has. It gets no interval. Where no torque of known size acts, as in a coast-down, only "
        "the ratios of inertias, stiffnesses and frictions are determined.",
        "Do the stated experiment, or hold the parameter with `--hold`."),
    "parameters-differ": Code(
        WARNING,
        "In `compare` a parameter differs by more than its uncertainty explains: between two records or two "
        "machines at the 5 % level over all parameters and pairs. Between the two sides of `--swap` the level is "
        "3 joint standard deviations, or a chi-square test at 0.27 %; for the first anti-resonance of two records "
        "it is 4 standard deviations. With one record each, a difference between "
        "machines cannot be separated from one between days.",
        "Record each machine several times, at different times; look for wear, lubrication or another load. A "
        "lower anti-resonance at a lower amplitude points to backlash. Between two sides check sign, scale and "
        "clock of the torque channels, and run `diagnose` on both recordings."),
    "records-scatter": Code(
        NOTE,
        "A parameter varies from recording to recording by more than the noise within them explains, at the 1 % "
        "level over all parameters. Its interval includes the scatter between recordings.",
        "State what was changed on purpose with `--record`; more recordings determine the scatter better."),
    "residual-conversion-error": Code(
        WARNING,
        "The conversion to two masses does not use the coefficient b1 of the transfer function. Here b1 is "
        "inconsistent with the estimated parameters: it differs from the value that they give by more than 4 "
        "standard deviations and 10 %.",
        "State a known lag or dead time of the torque, or a filter of the speed; then use `greybox` and "
        "`diagnose`."),
    "residual-correlated": Code(
        NOTE_OR_WARNING,
        "The residual of a polynomial model is correlated. In open loop an output-error model stays consistent, "
        "and the intervals take the correlation into account. In closed loop the estimate is consistent only with "
        "the right noise model. The poles of ARX and ARMAX models are biased even in open loop. Both cases are "
        "warnings.",
        "Use `--structure oe`, `bj` of a higher `--noise-order`, or `innovations` where torque noise excites the "
        "resonance; in closed loop log the reference and use `spectra`."),
    "residual-not-testable": Code(
        NOTE,
        "The residual is not tested. The torque is constant, the record is too short, or a free run differs from "
        "the record by rounding only, as in a record simulated without noise.",
        "Record while the torque changes."),
    "resonance-out-of-range": Code(
        WARNING,
        "The record samples the resonance too slowly, or does not excite it sufficiently. The resonance lies "
        "above a third of the sampling rate, or the response to the torque is below the noise there. Its damping "
        "and frequency are poorly determined.",
        "Record with a higher sampling rate; excite with sudden torque steps, as large as the drive allows."),
    "response-not-explained": Code(
        WARNING,
        "The residual of a fit to the frequency response is larger than the measured noise: chi-square per degree "
        "of freedom is 2 or more. Distortion, leakage or a missing body remains.",
        "Look at the picture of the response; try one more body, or several runs with other phases."),
    "shaft-not-identifiable": Code(
        WARNING_OR_FAILURE,
        "One rigid body explains the record as well as two masses with a shaft: the resonance is not excited. "
        "Stiffness and damping of the shaft, and the split of the inertia, are not identifiable. It is a failure "
        "where the step has no other parameter to identify.",
        "Excite the resonance with a chirp, a multisine, or sudden torque steps from a constant speed with "
        "several periods between them; or log the speed on the other side of the shaft."),
    "sides-not-compared": Code(
        WARNING,
        "In `compare --swap` no parameter has an interval in both files. The differences are stated, but their "
        "significance is unknown.",
        "Give the files that `greybox`, `backlash` or `blackbox` wrote, and free the same parameters."),
    "simulation-criterion": Code(
        NOTE,
        "The fit minimises the simulation error. Its intervals assume a torque without noise and are too narrow "
        "where the torque is noisy.",
        "Use `--criterion innovations`."),
    "suspect-sign": Code(
        WARNING,
        "The total inertia in the slow motion is clearly negative: the sign of torque or motion is suspect.",
        "Set `sign: -1` for one of the two in the channel map."),
    "suspect-unit": Code(
        WARNING,
        "The estimated inertia of the drive is a multiple or a fraction of its start value. If the factor is the "
        "ratio of two units, the text names the suspect unit.",
        "Check the units of torque and motion in the channel map, or the start values."),
    "torque-filtered": Code(
        WARNING,
        "The likelihood is far higher if the logged torque is taken as low-pass filtered with the stated time "
        "constant than if it is taken as correct or shifted. The filtered torque biases inertias.",
        "Log the torque in front of its filter, or the command."),
    "torque-in-feedback": Code(
        NOTE_OR_WARNING,
        "Granger's test shows feedback from the sensor to the torque. In closed loop a direct estimate of the "
        "frequency response is biased towards the negative inverse of the controller (warning). After a failed "
        "simulation fit it is a note: the motion may be imposed, and the torque the output.",
        "Log the reference for the indirect estimate, or excite with a periodic multisine. Where the motion is "
        "imposed, use `--criterion inverse`."),
    "torque-measurement-noise": Code(
        NOTE,
        "Part of the logged torque has no effect on the motion and is white, like measurement noise. The logged "
        "torque is a measurement, and the fit removes that part.",
        "State `torque_is: measurement` in the channel map; log the torque command if the drive offers it."),
    "torque-shifted": Code(
        WARNING,
        "The model is far likelier with the torque one sample earlier or later than it was logged. Drives that "
        "log the torque of the last cycle are late. Early stamps, a slow converter and a filtered speed have the "
        "same effect. Inertias are off by several per cent, and a diagnosis may name a third mass.",
        "Write the stated `shift` into the channel map and fit again, or free the dead time or the lag of the "
        "converter.",
        says="shift"),
    "torque-source": Code(
        NOTE_OR_WARNING,
        "Commanded and measured torque need different noise models. Where the channel map does not state "
        "`torque_is`, the torque is taken as the command, with noise that acts on the drive. The noise of a "
        "measured torque does not act on the drive. This is an errors-in-variables problem, and the parameters "
        "may be biased (warning).",
        "State `torque_is: command` or `torque_is: measurement` in the channel map; log the torque command if the "
        "drive offers it."),
    "torque-unsigned": Code(
        WARNING,
        "The channel map says that the torque is logged without a sign. `steady` gives it the sign of the motion, "
        "which is right where the motor drives. Where the load drives the motor, friction and load torque are "
        "exchanged.",
        "Log the torque with its sign if a load acts."),
    "torque-without-feedback": Code(
        NOTE,
        "The torque is a command, and Granger's test shows no feedback from the sensor to it. It is the input and "
        "the motion the output; a fit that simulates the motion is more efficient than `--criterion inverse`.",
        "Compare with `--criterion auto`."),
    "unidentified-value": Code(
        NOTE_OR_WARNING,
        "A parameter file states a value as `not-identifiable`, and the step uses it as if it were known. It is "
        "where a fit started, or ended without information. `tune` stops where the design depends on such a value. "
        "It is a note where the effect of the value is absent, as for a friction of zero, and in `compare` and "
        "`diagnose`, which fit most values again.",
        "Do the experiment that the file states for it, or state a known value with `--set`."),
    "unstable-estimate": Code(
        WARNING_OR_FAILURE,
        "The polynomial model has unstable poles and cannot be simulated. It is a failure for the one model of "
        "`blackbox`, and a warning in a comparison of several.",
        "Use another structure or order, or a record with more excitation."),
    "weak-instrument": Code(
        NOTE_OR_WARNING,
        "The least squares of `--criterion inverse` have no valid instrument, or a weak one. No reference of the "
        "loop is logged, or the reference depends on the sensor (Granger's test). Noise and disturbances then "
        "reach torque and motion through the loop, and `std_structure` bounds the bias. It is a warning where the "
        "reference explains little of the measured acceleration (first-stage F below 10).",
        "Log the reference of the outermost loop: reference_angle, reference_speed or reference_torque; record "
        "one that the drive follows, or a larger excitation."),
}
