from .system import (
    LOOKS as LOOKS,
    MADE_FOR as MADE_FOR,
    MOST_LAWS as MOST_LAWS,
    MOST_STATES as MOST_STATES,
    NARROW as NARROW,
    ORDER as ORDER,
    PARAMETERS as PARAMETERS,
    WIDE as WIDE,
    Cache as Cache,
    Filtering as Filtering,
    Laws as Laws,
    Pass as Pass,
    System as System,
    empty_cache as empty_cache,
)
from .table import fields as fields, packed as packed, place_of as place_of
