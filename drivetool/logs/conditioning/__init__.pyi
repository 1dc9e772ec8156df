from .parts import Cut as Cut, cut as cut, kept as kept, restarted as restarted
from .steps import Step as Step, condition as condition, parse_step as parse_step
