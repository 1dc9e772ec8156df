"""drivetool blackbox."""

from drivetool.cli.step import estimator_command

HELP = ("Start values from a gap-free record. A third-order model, converted to inertias, "
        "stiffness and damping.")


def _load():
    from drivetool.identify.blackbox import blackbox

    return blackbox


command = estimator_command("blackbox", _load)
