from .both_motors import Swap as Swap, swap as swap
from .both_sides import BEYOND as BEYOND, Figure as Figure, Side as Side, SwapLine as SwapLine
from .comparison import CompareOptions as CompareOptions, Comparison as Comparison, compare as compare
from .differences import FEWEST as FEWEST
