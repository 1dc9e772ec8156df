"""drivetool backlash."""

from drivetool.cli.step import estimator_command

HELP = "The half gap from a record that opens it."


def _load():
    from drivetool.identify.backlash import backlash

    return backlash


command = estimator_command("backlash", _load)
