"""Records with hidden effects and their labels; shares no code with drivetool.

    case = make_case("backlash", machine_seed=3)
    logs, held_out = case.write(folder, labels)
    start = write_start(case, folder)
"""

from tests.hidden.case import Case, Record, make_case
from tests.hidden.effects import CODES, KINDS
from tests.hidden.start import greybox_options, plain_values, write_start

__all__ = ["CODES", "KINDS", "Case", "Record", "greybox_options", "make_case", "plain_values", "write_start"]
