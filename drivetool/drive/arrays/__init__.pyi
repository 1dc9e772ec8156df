from .system import (
    MAX_GUARD_INSTANTS as MAX_GUARD_INSTANTS,
    MAX_SIZED_LAWS as MAX_SIZED_LAWS,
    MOST_STATES as MOST_STATES,
    NARROW_BLOCK as NARROW_BLOCK,
    SERIES_ORDER as SERIES_ORDER,
    SIZED_STATE_COUNTS as SIZED_STATE_COUNTS,
    WIDE_BLOCK as WIDE_BLOCK,
    Cache as Cache,
    FilterBuffers as FilterBuffers,
    Laws as Laws,
    ModalSums as ModalSums,
    SimulationBuffers as SimulationBuffers,
    System as System,
    empty_cache as empty_cache,
)
from .table import address_of as address_of, fields as fields, packed as packed
