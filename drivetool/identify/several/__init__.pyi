from .both_motors import Swap as Swap, swap as swap
from .both_sides import (
    MIN_SIGNIFICANT_RATIO as MIN_SIGNIFICANT_RATIO,
    Figure as Figure,
    Side as Side,
)
from .comparison import (
    CompareOptions as CompareOptions,
    Comparison as Comparison,
    compare as compare,
)
from .differences import (
    MIN_RECORDS_PER_MACHINE as MIN_RECORDS_PER_MACHINE,
)
from .sections import (
    DifferenceSection as DifferenceSection,
    SpreadSection as SpreadSection,
    SwapLineSection as SwapLineSection,
    SwapSection as SwapSection,
)
