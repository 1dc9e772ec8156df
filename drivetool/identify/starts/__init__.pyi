from .attempts import attempted as attempted, that_held as that_held
from .clouds import from_known as from_known
from .cooling import SHAPE as SHAPE, cooled as cooled, observers as observers, sides as sides
from .portions import by_portions as by_portions
from .resonance import resonances as resonances
from .rough import KNOWN as KNOWN, balanced as balanced, totals as totals
from .search import (
    AT_ONCE as AT_ONCE,
    CONFIRMED as CONFIRMED,
    Descent as Descent,
    agrees as agrees,
    apart as apart,
    searched as searched,
    values_of as values_of,
)
