"""Codes about the recordings of a site over time: alarms, smaller changes, and what limits them."""

from drivetool.finding_codes.code import NOTE, WARNING, Code

CODES = {
    "copied-recordings": Code(
        NOTE,
        "Recordings of one machine have equal values with equal standard deviations: they are copies. Only one of "
        "them is used.",
        "Take the copies out of the site."),
    "few-recordings": Code(
        NOTE,
        "A machine has too few recordings of one kind for a trend, or too few days if one day has several "
        "recordings. Its means are stated; no drift or step is searched for.",
        "Record it again on further days."),
    "outlying-recording": Code(
        WARNING,
        "A recording lies at least five standard deviations from the value of all others of its machine. This is "
        "significant over all recordings and series of the site together. It is left out of the trends.",
        "Check that its machine, its channels and their units are assigned correctly, then what else differed "
        "when it was recorded. If it is the newest, record once more: if the next recording agrees with it, the "
        "trend has a step."),
    "recordings-correlated": Code(
        NOTE,
        "Once steps and drift are removed, neighbouring recordings are still correlated. Intervals and tests are "
        "widened for this correlation.",
        "Look for what varies slowly, such as the temperature. Small steps of this series may be parts of such a "
        "slow variation."),
    "small-change": Code(
        NOTE,
        "A parameter of a machine steps or drifts. The change is significant, but smaller than the alarm "
        "threshold.",
        "Watch it. The alarm threshold is set with `--alarm`."),
    "trend-alarm": Code(
        WARNING,
        "A parameter of a machine steps by at least five standard deviations of the runs before. Or it drifts by "
        "at least five standard deviations of the scatter about the fitted line. The change is significant for "
        "all series of the site together.",
        "Look for what changed at the machine at that time: wear, lubrication, load, temperature or a repair."),
    "undated-recordings": Code(
        NOTE,
        "Not all recordings of a machine have a date. Only their order is used, and days are not distinguished.",
        "Log absolute times, or name recordings by date."),
    "values-missing": Code(
        NOTE,
        "Some recordings have no fitted value of a parameter: it was held, not identifiable, not finite, or has "
        "no standard deviation where others have one. They are left out of its trend.",
        "See in the files of these recordings why they have none."),
}
