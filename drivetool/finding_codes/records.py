"""Codes about a recording: files, clocks, channels, units, sampling and conditioning."""

from drivetool.finding_codes.code import NOTE, NOTE_OR_WARNING, WARNING, Code

CODES = {
    "angle-wraps": Code(
        WARNING,
        "An angle repeatedly jumps back over its whole range, as a counter does that starts again at zero. The "
        "jumps are left in, so the angle is not continuous.",
        "Set `wrap` for this role in the channel map to the range of the counter."),
    "anti-aliased": Code(
        NOTE,
        "A channel has a higher sampling rate than the common grid. Sensors pass a zero-phase low-pass filter "
        "before they are resampled, inputs are averaged over each step, so nothing is aliased.",
        "Nothing, unless the motion of interest lies above the stated cut-off frequency."),
    "broken-messages": Code(
        WARNING,
        "Messages of an MCAP topic do not match their encoding or schema. They are left out.",
        "Check the recorder and the schema that it writes."),
    "clock-offset": Code(
        NOTE_OR_WARNING,
        "Two channels with clocks of their own agree better when one of them is shifted in time. It is a warning "
        "for two sensors of one body; across a shaft a backlash gap looks the same, so it is a note. Nothing is "
        "shifted.",
        "If the clocks differ, write the stated `shift` into the channel map."),
    "clock-restored": Code(
        NOTE,
        "The time stamps were cut to a coarse resolution, such as milliseconds at 4 kHz. A uniform clock lies "
        "within one resolution of all of them; its times are used instead.",
        "Log time stamps in full if the clock may not have been uniform."),
    "clock-shifted": Code(
        NOTE,
        "The time stamps of a channel are shifted by the `shift` that the channel map states.",
        "Nothing."),
    "conditioned": Code(
        NOTE,
        "A conditioning step of `--condition` was applied to the recording before anything else. The text states "
        "the step and what it changed.",
        "Nothing; compare with a run without it if in doubt."),
    "constant-signal": Code(
        WARNING,
        "A channel has the same value throughout. It carries no information for a fit.",
        "Check that the right channel is mapped to this role."),
    "cut-off": Code(
        WARNING,
        "A sensor stays at exactly its largest or smallest value while the motion goes on: its range is "
        "saturated. Fits of physical models leave out these samples.",
        "Widen the range of the sensor or of its channel."),
    "damaged-log": Code(
        WARNING,
        "Part of the log file is truncated or corrupt. What can be read is used.",
        "Record or export the log again; repair an MCAP file with `mcap recover`."),
    "gaps": Code(
        WARNING,
        "The recording is interrupted. It is used as several segments, and no model runs across a gap.",
        "Check the recorder for overload."),
    "held-samples": Code(
        WARNING,
        "A sensor repeats every value a fixed number of times: it is logged faster than it is updated, and its "
        "values are late by up to the update interval. Fits of physical models leave out the repeats.",
        "Log the sensor at its own rate, or with its own time stamps."),
    "interpolated": Code(
        WARNING,
        "A sensor lies on straight lines over a fixed number of samples: the logger interpolated between the "
        "measured values. Fits of physical models use the measured values only.",
        "Log the sensor at its own rate, without interpolation."),
    "lost-samples": Code(
        WARNING,
        "Single samples are missing. The torque is held over them, and sensors have no value there.",
        "Check the recorder for overload."),
    "made-of-counts": Code(
        WARNING,
        "A speed comes in steps and has the noise of differences: it is the difference of an encoder's counts "
        "from one sample to the next. This quantised, differentiated speed has correlated noise, which a fit can "
        "take for missing physics.",
        "Log the counts as an angle, or integrate them: `--condition 'integrate roles=ROLE'`."),
    "missing-time": Code(
        WARNING,
        "Samples have no usable time stamp. They are left out.",
        "Check the recorder."),
    "missing-values": Code(
        WARNING,
        "A channel has samples that are not a number, infinite or impossibly large. They count as missing.",
        "Check the recorder and the sensor."),
    "not-read": Code(
        WARNING,
        "A topic or column of the file cannot be read, for the stated reason. The others are used.",
        "Export it in another encoding, if it is needed."),
    "not-usable": Code(
        WARNING,
        "The file can be read, but no estimator can use it: a role, a unit or the clock is missing or wrong. The "
        "text states the error that a later step would raise.",
        "Follow the advice in the text; most cases are settled in the channel map."),
    "out-of-order": Code(
        WARNING,
        "Single samples are not in the order of their time stamps. They are sorted.",
        "Check the recorder."),
    "part-left-out": Code(
        WARNING,
        "The logger changed its rate, and what it logged at one of the rates cannot be used, for the stated "
        "reason. The rest of the recording is used.",
        "Nothing, unless that part matters; then follow the advice in the text."),
    "rate-changes": Code(
        NOTE,
        "The logger changed its rate: the interval between samples is longer or shorter by a factor from some time "
        "on. What is at each rate has a grid of its own; steady, blackbox, greybox and backlash fit all of it.",
        "Nothing; start states are free where the rate changes."),
    "rate-not-used": Code(
        WARNING,
        "The logger changed its rate, and this step works at one rate. It uses the one with most excitation, by "
        "the sum of the squares of the motor torque about its mean, and leaves out the rest.",
        "Record at one rate; steady, blackbox, greybox and backlash fit every rate."),
    "receive-times": Code(
        WARNING,
        "The messages of an MCAP topic were received in batches, which says nothing of when they were sampled. A "
        "clock of the messages themselves is steady and is used.",
        "Name that clock with `time` in the channel map."),
    "repeated-time": Code(
        WARNING,
        "Samples repeat the time stamp of the one before. They are left out.",
        "Check the resolution of the recorder's clock."),
    "resampled": Code(
        NOTE_OR_WARNING,
        "The channels are resampled to one uniform grid: torques are held, sensors interpolated. It is a note "
        "where channels have clocks of their own, and a warning where one clock is irregular.",
        "Record with a fixed sampling rate."),
    "role-missing": Code(
        WARNING,
        "The channel map names a channel that the log does not have.",
        "Correct the channel map."),
    "role-not-used": Code(
        NOTE_OR_WARNING,
        "Roles of the recording that this step does not use, with the reason of each. It is a warning where the "
        "drive has no such body or shaft.",
        "Give the drive the body, or take the role out of the channel map."),
    "role-unclear": Code(
        WARNING,
        "The name of a channel in the channel map fits several channels of the log.",
        "Write the full name of the channel into the channel map."),
    "short-segments": Code(
        NOTE_OR_WARNING,
        "Segments of fewer than ten samples are left out, since no model can be judged over them.",
        "Nothing, unless much of the recording is lost; then check the recorder."),
    "sparse-sensor": Code(
        NOTE,
        "A sensor has a value at fewer than half of the points of the common grid, because it is slower than the "
        "others.",
        "Nothing; log it faster if its bandwidth matters."),
    "speed-angle-mismatch": Code(
        WARNING,
        "A speed and the differentiated angle of the same body do not correlate. One of the two is not what the "
        "channel map says, or the angle wraps around.",
        "Check that both channels belong to the same shaft; set `wrap` for an angle that starts again."),
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
    "speed-scale": Code(
        WARNING,
        "A speed and the differentiated angle of the same body differ by a factor: a unit, a scale or a gear "
        "ratio is wrong.",
        "Check units, scales and ratios in the channel map."),
    "speed-sign": Code(
        WARNING,
        "A speed and the differentiated angle of the same body have opposite signs.",
        "Set `sign: -1` for one of the two in the channel map."),
    "topic-recorded-twice": Code(
        WARNING,
        "Two channels of an MCAP topic hold the same messages, byte for byte, as from two recorders. The one with "
        "more messages is used.",
        "Check whether two recorders ran; record once."),
    "torque-missing": Code(
        NOTE_OR_WARNING,
        "The input torque has no value at some samples. The recording is cut into segments there, since a model "
        "cannot run without its input.",
        "Check the recorder."),
    "unsupported-samples": Code(
        WARNING,
        "Single samples of a motion lie eight standard deviations and more from all of their neighbours: drops to "
        "zero of a bus that answers late, or outliers. What has mass does not move like that. Physical models are "
        "fitted without those samples; spectra and polynomial models take them as they are.",
        "Check the sensor and its bus. `--condition despike` replaces such samples for every step."),
    "unusual-units": Code(
        WARNING,
        "The torque is a force while the motion is an angle, or the other way round. The estimated inertias then "
        "have a mixed unit.",
        "Check the units of both channels."),
    "value-wraps": Code(
        WARNING,
        "A torque or a speed jumps by the range of its register, 2^8 to 2^32 counts. Negative numbers that were "
        "read as unsigned do that, and counters that start again. The jumps are left in.",
        "Set `wrap` for this role in the channel map to that range; then the jumps are undone."),
    "wrap-unsure": Code(
        WARNING,
        "An angle with the stated `wrap` moves by almost half its range between neighbouring samples, so the "
        "direction of that move is ambiguous.",
        "Record the angle faster, or correct `wrap` in the channel map."),
}
