"""Codes about identification: spectra, black-box, grey-box and backlash fits."""

from drivetool.finding_codes.code import FAILURE, NOTE, NOTE_OR_WARNING, WARNING, WARNING_OR_FAILURE, Code

CODES = {
    "closed-loop": Code(
        WARNING,
        "Granger's test shows feedback from the sensor to the torque. In closed loop a direct estimate of the "
        "frequency response is biased towards the negative inverse of the controller.",
        "Log the reference for the indirect estimate, or excite with a periodic multisine."),
    "contradicts-the-file": Code(
        WARNING,
        "A parameter lies more than 8 combined standard deviations from its value in the parameter file: the "
        "estimate is inconsistent with its prior. One of the two fits lacks an effect.",
        "Run `diagnose` on both recordings."),
    "conversion-left-over": Code(
        WARNING,
        "The conversion to two masses does not use the coefficient b1 of the transfer function. Here b1 "
        "contradicts the estimated parameters: it is more than 4 standard deviations and 10 % off.",
        "State a known lag or dead time of the torque, or a filter of the speed; then use `greybox` and "
        "`diagnose`."),
    "damping-not-told": Code(
        NOTE_OR_WARNING,
        "The estimated shaft damping is negative, which is not physical, and is set to zero. It is a warning "
        "where its whole 95 % interval is negative.",
        "Leave more time between the torque steps, so that the decay of the oscillation is recorded."),
    "direction-changes": Code(
        WARNING,
        "The motor reverses in the record. Coulomb friction then changes its sign, and the linear black-box model "
        "does not hold it.",
        "Use a record of one direction, or go on to `greybox`."),
    "distortion-hidden": Code(
        NOTE,
        "The periodic excitation fills every spectral line of its band. Nonlinear distortion repeats with the "
        "period too, and cannot be told from the linear response.",
        "Excite odd lines only and leave some of them out, or record several runs with other phases."),
    "distortion-over-runs": Code(
        NOTE,
        "The frequency response varies between the runs more than the noise explains: its total variance is over "
        "four times the noise variance. The drive is nonlinear, or changes between runs.",
        "Weigh a fit with the total variance; compare amplitudes."),
    "empty-lines": Code(
        NOTE,
        "The excitation leaves gaps between its spectral lines. The frequency response is not known in them.",
        "Excite the missing lines if a resonance may lie there."),
    "errors-not-white": Code(
        NOTE,
        "The residual of a polynomial model is correlated. In open loop the estimate stays consistent for this "
        "structure, and the intervals take the correlation into account by an autoregression.",
        "Compare spectra; use `--structure innovations` where torque noise excites the resonance."),
    "even-distortion": Code(
        NOTE_OR_WARNING,
        "The output has power on even spectral lines that are not excited: an even nonlinearity, as of friction "
        "that depends on the direction. Above -40 dB of the signal it is a warning.",
        "Look for direction-dependent friction or a gap loaded on one side; the linear model holds at this "
        "amplitude only."),
    "explained-to-rounding": Code(
        NOTE,
        "A free run of the model differs from the record by no more than the digits of the record and of the "
        "simulation make. No test of the residual is made.",
        "Nothing: a simulated record has no noise."),
    "fitted-again": Code(
        NOTE,
        "Linear parameters that are a few per cent off would bias the half gap: the load is light compared with "
        "the motor, or a measured shaft torque shows many passages. They are fitted again together with it.",
        "Use `--hold` for values that are known for certain."),
    "gap-left-out": Code(
        WARNING,
        "The model of two masses lacks a backlash gap: fitted beside it, a drive with a gap raises the log "
        "likelihood by more than 12, under the same noise models. All fits without the gap share its error. The "
        "shaft and the two inertias get no interval.",
        "Fit it too with `--free shaft.half_gap`; if there is no gap, say so with `--set shaft.half_gap=0`."),
    "gap-may-have-opened": Code(
        WARNING,
        "The shaft torque changes its sign in the record. A backlash gap would open there, and the fitted model "
        "has none. `greybox` says so where it cannot ask the record for a gap: with several shafts, or a stiffness "
        "that is held.",
        "Use torque steps upward from a constant speed; if there is no gap, say so with `--set shaft.half_gap=0`."),
    "gap-not-crossed": Code(
        WARNING,
        "The gap opens in the record but its other side is never reached. The half gap is known only from below.",
        "Record torque steps of both signs."),
    "gap-not-opened": Code(
        WARNING,
        "The shaft torque never changes its sign, so the record does not open the gap. The half gap is not "
        "identifiable.",
        "Record alternating torque steps larger than the idle torque."),
    "half-gap-ambiguous": Code(
        WARNING,
        "Starts of the multi-start fit end at clearly different half gaps with equal likelihood. The half gap "
        "gets no interval.",
        "Record torque steps that cross the gap both ways."),
    "half-gap-not-distinguishable": Code(
        NOTE,
        "The profile likelihood of the half gap includes zero. There is an upper limit and no lower one.",
        "Record smaller torque steps around zero shaft torque to show a smaller gap."),
    "half-gap-unbounded": Code(
        WARNING,
        "The profile likelihood of the half gap is flat towards large values. There is a lower limit and no upper "
        "one.",
        "Record torque steps that cross the gap both ways."),
    "held-value-contradicted": Code(
        WARNING,
        "A parameter is held at a value that the record contradicts, and the fitted ones compensate for it. "
        "Freeing it alone raises the log likelihood by more than 30, changes it by more than 1 %, and leaves no "
        "correlated errors. `greybox` tests the dead time, the half gaps and the names after `--hold`, unless "
        "they are zero. It does so only where another finding says that the fit lacks something.",
        "Fit it too with `--free`, or correct it with `--set`."),
    "friction-as-in-the-file": Code(
        NOTE,
        "The shaft torque was measured, and this record does not tell a body's friction to a third of itself. The "
        "value of the parameter file stands, and its covariance is propagated.",
        "Record steps about speeds that differ more, or name the parameter with `--free`."),
    "gap-law": Code(
        NOTE,
        "Both published laws of a gap were fitted, and one leads by more than 7 of log likelihood: the damping is "
        "part of the contact (`inside`), or acts in the gap too (`always`). The file has it as `damping_law`.",
        "Keep `damping_law` in the parameter file."),
    "gap-law-undetermined": Code(
        NOTE,
        "Both published laws of a gap were fitted, and neither leads by more than 7 of log likelihood. The values "
        "of both are in the evidence; the estimate is by the law of the parameter file, if its fit settled.",
        "Record more passages through the gap, slow ones too."),
    "held-values-dominate": Code(
        NOTE,
        "The uncertainty of held values, propagated from the parameter file, contributes more than twice the "
        "fit's own uncertainty to the stated interval.",
        "Free the held parameters with `--free`, if this record determines them better."),
    "impossible-conversion": Code(
        FAILURE,
        "The fitted transfer function is not that of a drive: an inertia or a stiffness comes out negative or "
        "beyond its bound. No parameters are given.",
        "Check signs and units of torque and speed in the channel map, and excite the resonance."),
    "incoherent": Code(
        FAILURE,
        "The coherence of torque and output is below 0.5 at every frequency: the output is hardly a linear "
        "response to the torque. The estimate describes noise.",
        "Check the channels and their clocks, excite more, or record longer."),
    "innovations-correlated": Code(
        NOTE_OR_WARNING,
        "The one-step prediction errors (innovations) are correlated: the model lacks an effect. Intervals are "
        "conditional on its structure. It is a note where quantisation explains the correlation.",
        "Run `validate`, then `diagnose`.", says="doubt"),
    "input-delay": Code(
        WARNING,
        "The model is far likelier if the torque acts later than it was logged, by a lag or by a part of a sample. "
        "The converter has a lag or a dead time, or the speed is filtered; no `shift` of whole samples cures it.",
        "Free `converter.bandwidth` or `converter.dead_time`, or set `sensor.bandwidth`."),
    "light-load": Code(
        WARNING,
        "The load has less than a fifth of the motor's inertia and only the motor is measured. The half gap is "
        "biased by small errors of held parameters, so it gets no interval.",
        "Log the shaft torque or the load speed, or pass the parameter file of a `greybox` step."),
    "low-coherence": Code(
        WARNING,
        "The coherence is below 0.5 at more than a tenth of the spectral lines. The frequency response is "
        "unreliable there.",
        "Use the other lines only; excite more, or use longer frames for sharp resonances."),
    "mass-left-out": Code(
        WARNING,
        "The model of two masses lacks a third: fitted beside it, a drive whose load is split by one more shaft "
        "raises the log likelihood by more than 12 and leaves no correlated errors. All fits without it share its "
        "error. The shaft and the two inertias get no interval.",
        "Fit it too with `--drive three-mass`, or run `diagnose`. A sensor at the load shows it best."),
    "model-error": Code(
        WARNING,
        "The drive model has a structural error, which a noise model would hide. Without a gap, a law that the "
        "motion foretells carries more than 1 % of the torque, and the text names it. Or free runs reject the "
        "likeliest noise model, or credible explanations of the record disagree by more than their noise. Of other "
        "drives, a fit for simulation reproduces the held-out end of the record clearly better than a fit for "
        "one-step prediction.",
        "Run `diagnose`. The intervals of the default fit include the disagreement as `std_structure`; all "
        "others are conditional on the structure.", says="doubt"),
    "no-conversion": Code(
        NOTE,
        "The polynomial model has no equivalent chain of masses: its order, or its zeros and poles, do not fit "
        "the drive. No inertias and stiffnesses are given.",
        "Choose `--order` 2 n - 1 for n bodies, or another `--drive`."),
    "no-fit": Code(
        WARNING,
        "A structure of the comparison could not be fitted to a record, for the stated reason. It is missing in "
        "the tables.",
        "Leave it out, or change the order."),
    "no-instrument": Code(
        NOTE,
        "No reference of the loop is logged for `--criterion inverse`, or it answers the sensor (Granger's test). "
        "Sensor noise and disturbances reach both the torque and the motion through the loop, so least squares is "
        "biased. `std_structure` bounds the bias.",
        "Log what the outermost loop is asked for: reference_angle, reference_speed or reference_torque."),
    "noise-model-matters": Code(
        WARNING,
        "The torque depends on the sensor by feedback, and the residual of the polynomial model is correlated. In "
        "closed loop a direct fit is consistent only with the right noise model.",
        "Compare with `--structure bj` of a higher `--noise-order`, or log the reference and use `spectra`."),
    "noise-model-wrong": Code(
        WARNING,
        "The residual of an ARX or ARMAX model is correlated. Its noise shares the poles of the drive, so these "
        "are biased even in open loop.",
        "Use `--structure oe`, `bj` or `innovations`."),
    "not-identifiable": Code(
        NOTE_OR_WARNING,
        "The record does not determine a parameter: it has no effect on the outputs, or only a combination with "
        "other parameters has. It gets no interval. Where no torque of known size acts, as in a coast-down, "
        "only the ratios of inertias, stiffnesses and frictions are determined.",
        "Do the stated experiment, or hold the parameter with `--hold`."),
    "not-settled": Code(
        WARNING,
        "The fit did not converge: the likelihood was still rising when it stopped, or no second start reached "
        "the same optimum, or a rigid shaft predicts better. No intervals are given.",
        "Start nearer with `--set`, hold what is known with `--hold`, or use a record with more excitation."),
    "notch-moves": Code(
        WARNING,
        "The first anti-resonance differs between records by more than 4 standard deviations. The records are not "
        "of one linear drive; backlash lowers it at small amplitudes.",
        "Compare amplitudes, and excite odd lines only."),
    "number-of-bodies": Code(
        NOTE_OR_WARNING,
        "Cross-validation of polynomial models chooses this number of bodies. It is a warning where the drive has "
        "another number.",
        "Use a drive with that many bodies, or give `--order` to keep this one."),
    "odd-distortion": Code(
        NOTE_OR_WARNING,
        "The output has power on odd spectral lines that are not excited: an odd nonlinearity, as of Coulomb "
        "friction or backlash. Above -40 dB of the signal it is a warning.",
        "Look for Coulomb friction or backlash; the linear model holds at this amplitude only."),
    "order-too-high": Code(
        WARNING,
        "A pole and a zero of the polynomial model cancel within their uncertainty. The order is higher than the "
        "records support.",
        "Lower `--order`, or leave it out to choose it by cross-validation."),
    "machines-differ": Code(
        WARNING,
        "In `compare` with `--machine` a parameter differs between two machines by more than each varies. The "
        "level is 5 % over all parameters and pairs of machines.",
        "Look for wear, lubrication or another load where friction or inertia differs."),
    "records-differ": Code(
        WARNING,
        "In `compare` a parameter differs between two records by more than the noise within them explains, at the "
        "5 % level over all parameters and pairs of records. With one record each, another machine and another day "
        "look the same.",
        "Record each machine several times, at different times."),
    "records-scatter": Code(
        NOTE,
        "A parameter varies from recording to recording by more than the noise within them explains, at the 1 % "
        "level over all parameters. Its interval holds for the machine and not for one day.",
        "State what was changed on purpose with `--record`; more recordings tell the scatter better."),
    "resonance-near-sampling-rate": Code(
        WARNING,
        "The resonance lies above a third of the sampling rate. Its damping and frequency are poorly determined.",
        "Record with a higher sampling rate."),
    "resonance-not-shown": Code(
        WARNING,
        "A rigid shaft predicts the record as well as an elastic one. Stiffness and damping of the shaft, and the "
        "split of the inertia, are not identifiable.",
        "Excite the resonance with a chirp or a multisine, or log the speed on the other side of the shaft."),
    "resonance-outside-band": Code(
        WARNING,
        "At the estimated resonance the response to the torque is below the noise. The resonance is outside the "
        "excited band.",
        "Record sudden torque steps, as large as the drive allows."),
    "response-not-explained": Code(
        WARNING,
        "The residual of a fit to the frequency response is larger than the measured noise: chi-square per degree "
        "of freedom is 2 or more. Distortion, leakage or a missing body remains.",
        "Look at the picture of the response; try one more body, or several runs with other phases."),
    "samples-left-out": Code(
        WARNING,
        "A few samples have one-step prediction errors above 8 robust standard deviations: sensor glitches or "
        "impacts. They are left out and the fit is repeated.",
        "Look at the stated instants; run `diagnose` if impacts are possible."),
    "shaft-not-excited": Code(
        FAILURE,
        "One rigid body explains the record as well as two masses with a shaft. The oscillation of the shaft is "
        "not excited, and inertias and stiffness are not identifiable.",
        "Record sudden torque steps upward from a constant speed, with several periods between them."),
    "sides-differ": Code(
        WARNING,
        "In `compare --swap` the files of the two sides differ: a parameter by more than 3 joint standard "
        "deviations, or all together by a chi-square test at 0.27 %. One of the two fits has an error that its "
        "intervals leave out, or the drive changed between the recordings.",
        "Check sign, scale and clock of the torque channels; run `diagnose` on both recordings."),
    "sides-not-compared": Code(
        WARNING,
        "In `compare --swap` no parameter has an interval in both files. The differences are stated, and nothing "
        "says whether they are large.",
        "Give the files that `greybox`, `backlash` or `blackbox` wrote, and free the same parameters."),
    "sign-doubted": Code(
        WARNING,
        "The total inertia that the slow motion shows is clearly negative: the sign of torque or motion is "
        "suspect.",
        "Set `sign: -1` for one of the two in the channel map."),
    "simulation-criterion": Code(
        NOTE,
        "The fit minimises the simulation error. Its intervals assume a torque without noise and are too narrow "
        "where the torque is noisy.",
        "Use `--criterion innovations`."),
    "start-contradicted": Code(
        WARNING,
        "The first samples of a recording contradict the start state stated with `--start`, by more than 8 "
        "standard deviations. What is fitted compensates for it and is biased.",
        "Leave `--start` out, or begin where the drive rests: `--condition 'keep from=SECONDS'`."),
    "torque-command-assumed": Code(
        NOTE,
        "The channel map does not say whether the torque is a command or a measurement. It is taken as the "
        "command, with noise between it and the shaft.",
        "State `torque_is: command` or `torque_is: measurement` in the channel map."),
    "torque-early": Code(
        WARNING,
        "The model is far likelier with the torque one sample later than it was logged. The stamps are early, the "
        "converter answers late, or the speed is filtered; all look the same.",
        "Write the stated `shift` into the channel map, or free the dead time or the lag of the converter.",
        says="shift"),
    "torque-filtered": Code(
        WARNING,
        "The model is far likelier with the torque as it was in front of a low-pass of the stated time constant "
        "than with the torque as logged or shifted. The log has a filtered torque, and inertias are biased.",
        "Log the torque in front of its filter, or the command."),
    "torque-is-the-answer": Code(
        NOTE,
        "The simulating fit failed (`not-settled` or `explains-nothing`), and Granger's test shows feedback from "
        "the sensor to the torque. The motion may be imposed, and the torque the output.",
        "Try `--criterion inverse`."),
    "torque-is-the-cause": Code(
        NOTE,
        "The torque is a command, and Granger's test shows no feedback from the sensor to it. It is the input and "
        "the motion the output; a fit that simulates the motion is more efficient than `--criterion inverse`.",
        "Compare with `--criterion auto`."),
    "torque-is-magnitude": Code(
        WARNING,
        "The channel map says that the torque is logged without a sign. `steady` gives it that of the motion, "
        "as is right where the motor drives. Where the load is the larger one, friction and load change places.",
        "Log the torque with its sign if a load acts."),
    "torque-is-measured": Code(
        WARNING,
        "The input is a measured torque. Its sensor noise does not act on the drive, so it is an "
        "errors-in-variables problem, and the parameters may be biased.",
        "Log the torque command if the drive offers it."),
    "torque-late": Code(
        WARNING,
        "The model is far likelier with the torque one sample earlier than it was logged. Drives that log the "
        "torque of the cycle that has passed do that. Inertias are off by several per cent, and a diagnosis may "
        "name a third mass.",
        "Write the stated `shift` into the channel map, and fit again.", says="shift"),
    "torque-noise-unfelt": Code(
        NOTE,
        "Part of the logged torque has no effect on the motion. It is as strong at all frequencies as the noise "
        "of a measurement is, so the log is a measurement. The fit takes that part out.",
        "State `torque_is: measurement` in the channel map; log the torque command if the drive offers it."),
    "unit-doubted": Code(
        WARNING,
        "The drive has a multiple of the inertia it starts with. Where the factor is that between two units, a "
        "unit is suspect, and the text names it.",
        "Check the units of torque and motion in the channel map, or the start values."),
    "unstable-estimate": Code(
        WARNING_OR_FAILURE,
        "The polynomial model has unstable poles and cannot be simulated. It is a failure for the one model of "
        "`blackbox`, and a warning in a comparison of several.",
        "Use another structure or order, or a record with more excitation."),
    "weak-instrument": Code(
        WARNING,
        "The reference explains little of the measured acceleration (first-stage F below 10). The instruments of "
        "`--criterion inverse` are weak, and the estimate is that of least squares.",
        "Record a reference that the drive follows, or a larger excitation."),
}
