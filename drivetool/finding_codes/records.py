"""Codes about a recording: files, clocks, channels, units, sampling and conditioning."""

from drivetool.finding_codes.code import NOTE, NOTE_OR_WARNING, WARNING, Code

CODES = {
    "channel-map-mismatch": Code(
        WARNING,
        "The channel map names a channel that the log does not have, or a name that fits several of its channels.",
        "Write the full name of a channel of the log into the channel map."),
    "clock-corrected": Code(
        NOTE_OR_WARNING,
        "The time stamps of a channel are replaced by better ones. Stamps of coarse resolution are replaced by a "
        "uniform clock that differs from each of them by at most one resolution step. Or a stated `shift` is "
        "added (note). Or messages received in batches get their own steady time stamps instead (warning).",
        "Log time stamps with full resolution, made where the signal is sampled; name the clock of the messages "
        "with `time` in the channel map."),
    "clock-offset": Code(
        NOTE_OR_WARNING,
        "The motion in two channels with separate clocks agrees better when one channel is shifted in time. It is "
        "a warning for two sensors of one body. Across a shaft a backlash gap has the same effect, so it is a "
        "note. Nothing is shifted.",
        "If the clocks differ, write the stated `shift` into the channel map."),
    "conditioned": Code(
        NOTE,
        "A conditioning step of `--condition` was applied to the recording before anything else. The text states "
        "the step and what it changed.",
        "Nothing; compare with a run without this conditioning step if in doubt."),
    "constant-signal": Code(
        WARNING,
        "A channel has the same value throughout. It carries no information for a fit.",
        "Check that the right channel is mapped to this role."),
    "log-damaged": Code(
        WARNING,
        "A part of the log cannot be read: the file is truncated or corrupt, messages do not match their schema, "
        "or the encoding of a channel is unknown. What can be read is used.",
        "Record or export the log again, in another encoding if that channel is needed; repair an MCAP file with "
        "`mcap recover`."),
    "outliers-left-out": Code(
        WARNING,
        "Single samples lie eight standard deviations and more from all of their neighbours, or from the one-step "
        "prediction of the model. Bus dropouts to zero, sensor glitches and impacts are possible causes. Fits of "
        "physical models leave them out; spectra and polynomial models take them as they are.",
        "Check the sensor and its bus at the stated times; `--condition despike` replaces such samples for every "
        "step. Run `diagnose` if impacts are possible."),
    "quantised-speed": Code(
        WARNING,
        "A speed is quantised and has the noise of a difference quotient: it is the difference of an encoder's "
        "counts from one sample to the next. This quantised, differentiated speed has correlated noise, which a "
        "fit can mistake for an unmodelled effect.",
        "Log the counts as an angle, or integrate them: `--condition 'integrate roles=ROLE'`."),
    "rate-changes": Code(
        NOTE_OR_WARNING,
        "The logger changed its rate: from some time on the interval between samples is longer or shorter by a "
        "factor. The samples of each rate have a time grid of their own; steady, blackbox, greybox and backlash "
        "fit all rates. It is a warning where a rate is left out: its samples cannot be used, or the step works "
        "at one rate and uses the rate with the largest excitation.",
        "Record at one rate."),
    "recording-interrupted": Code(
        NOTE_OR_WARNING,
        "The recording is interrupted. It is used as several segments, and no model runs across a gap. Segments "
        "of fewer than ten samples are left out.",
        "Check the recorder for overload, if much of the recording is lost."),
    "recording-not-usable": Code(
        WARNING,
        "The file can be read, but no estimator can use it: a role, a unit or the clock is missing or wrong. The "
        "text states the error that a later step would raise.",
        "Follow the action that the text states; most cases are corrected in the channel map."),
    "resampled": Code(
        NOTE_OR_WARNING,
        "The channels are resampled to one uniform grid: inputs are held or averaged over each step, sensors are "
        "interpolated. A faster sensor passes a zero-phase low-pass filter first, so nothing is aliased. A slower "
        "sensor has values only at some points of the grid. It is a warning where one clock is irregular.",
        "Record with a fixed sampling rate; log a slow sensor faster if its bandwidth matters."),
    "role-not-used": Code(
        NOTE_OR_WARNING,
        "This step does not use some roles of the recording; the text states the reason for each. It is a warning "
        "where the drive has no such body or shaft.",
        "Give the drive the body, or remove the role from the channel map."),
    "samples-missing": Code(
        WARNING,
        "Single samples of a channel are missing, or are not a number, infinite or impossibly large. The torque "
        "is held over them, and sensors have no value there.",
        "Check the recorder for overload, and the sensor."),
    "samples-not-measured": Code(
        WARNING,
        "The logger holds each value of a sensor over a fixed number of samples, or interpolates between measured "
        "values. Held values are late by up to the update interval. Fits of physical models use the measured "
        "values only.",
        "Log the sensor at its own rate, without interpolation, or with its own time stamps."),
    "signal-saturated": Code(
        WARNING,
        "A sensor stays at exactly its largest or smallest value while the motion goes on: its range is "
        "saturated. Fits of physical models leave out these samples.",
        "Widen the range of the sensor or of its channel."),
    "speed-angle-mismatch": Code(
        WARNING,
        "A speed and the differentiated angle of the same body differ by a sign or a factor, or do not correlate. "
        "A unit, a scale, a sign or a gear ratio is wrong, the angle wraps around, or one of the two is another "
        "channel.",
        "Check units, `sign`, `wrap` and ratios in the channel map, and that both channels belong to the same "
        "shaft."),
    "speed-delay": Code(
        WARNING,
        "A speed lags or leads the differentiated angle of the same body by a fixed time. The difference acts "
        "like a dead time in the loop and biases damping and stiffness.",
        "Use the angle as the output, or correct the clock of one of the two."),
    "speed-filtered": Code(
        WARNING,
        "A speed is the differentiated angle behind a low-pass filter with the stated corner frequency. Its phase "
        "lag biases damping, stiffness and dead time.",
        "Use the angle as the output and leave the speed out of the channel map."),
    "time-stamps-invalid": Code(
        WARNING,
        "Samples have no usable time stamp, repeat the previous time stamp, or are out of order. Those out of "
        "order are sorted, the others are left out.",
        "Check the recorder and the resolution of its clock."),
    "topic-duplicated": Code(
        WARNING,
        "Two channels of an MCAP topic hold the same messages, byte for byte, for example from two recorders. The "
        "one with more messages is used.",
        "Check whether two recorders ran; record once."),
    "torque-missing": Code(
        NOTE_OR_WARNING,
        "The input torque has no value at some samples. The recording is cut into segments there, since a "
        "simulation needs its input.",
        "Check the recorder."),
    "units-mixed": Code(
        NOTE_OR_WARNING,
        "The torque of a recording is a force while its motion is an angle, or the other way round. The estimated "
        "inertias then have a unit that mixes rotation and translation. In a trend, the recordings of a machine "
        "state one parameter in several units. Each unit then forms a separate series (note).",
        "Check the units of both channels; give all recordings of a machine one unit of torque, by a channel map "
        "or a torque constant."),
    "value-wraps": Code(
        WARNING,
        "An angle, a torque or a speed jumps by the range of its counter, 2^8 to 2^32 counts for a register. "
        "Causes are counters that overflow, and negative numbers that were read as unsigned. The jumps are not "
        "corrected.",
        "Set `wrap` for this role in the channel map to the range of the counter; then the signal is unwrapped."),
    "wrap-ambiguous": Code(
        WARNING,
        "An angle with the stated `wrap` moves by almost half its range between neighbouring samples, so the "
        "direction of that move is ambiguous.",
        "Record the angle faster, or correct `wrap` in the channel map."),
}
