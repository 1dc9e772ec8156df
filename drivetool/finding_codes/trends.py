"""Codes about the recordings of a site over time: alarms, smaller changes, and what the recordings do not tell."""

from drivetool.finding_codes.code import NOTE, WARNING, Code

CODES = {
    "copied-recordings": Code(
        NOTE,
        "Recordings of one machine have equal values with equal standard deviations: they are copies. One of them "
        "counts.",
        "Take the copies out of the site."),
    "few-recordings": Code(
        NOTE,
        "A machine has too few recordings of one kind for a trend, or too few days where one of them has several. "
        "Its means are stated; drifts and steps are not looked for.",
        "Record it again on further days."),
    "outlying-recording": Code(
        WARNING,
        "A recording lies at least five standard deviations from what all others of its machine say. This is "
        "significant for all recordings and series of the site together. It is left out of the trends.",
        "See whether its machine, its channels and their units are named rightly, then what else was recorded. If "
        "it is the newest, record once more: a second one like it is a step."),
    "recordings-correlated": Code(
        NOTE,
        "Beside the steps and the drift that were found, neighbouring recordings are alike. Intervals and tests "
        "are widened for it.",
        "Look for what varies slowly, such as the temperature. Small steps listed there may be parts of it."),
    "small-change": Code(
        NOTE,
        "A parameter of a machine steps or drifts. The change is significant, and smaller than an alarm asks for.",
        "Watch it. The size of an alarm is set with `--alarm`."),
    "trend-alarm": Code(
        WARNING,
        "A parameter of a machine steps by at least five standard deviations of the runs before. Or it drifts by "
        "as much, about its line. The change is significant for all series of the site together.",
        "Look for what changed at the machine at that time: wear, lubrication, load, temperature or a repair."),
    "undated-recordings": Code(
        NOTE,
        "Not all recordings of a machine say when they were made. They count in their order, and days are not told "
        "apart.",
        "Log absolute times, or name recordings by date."),
    "units-changed": Code(
        NOTE,
        "Recordings of a machine state one parameter in several units. Each unit is a series of its own, and a "
        "change from one to the other is not looked for.",
        "Give the recordings of a machine one unit of torque, by a channel map or a torque constant."),
    "values-missing": Code(
        NOTE,
        "Some recordings have no fitted value of a parameter: it was held, not identifiable, not finite, or has no "
        "standard deviation where others have one. They are left out of its trend.",
        "See in the files of these recordings why they have none."),
}
