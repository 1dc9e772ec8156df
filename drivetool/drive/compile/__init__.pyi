from . import numba_private as numba_private
from .compiled import (
    COMPILE as COMPILE,
    COMPILE_LAW as COMPILE_LAW,
    INLINED as INLINED,
    NO_OVERLAP as NO_OVERLAP,
    as_unit as as_unit,
)
from .machine_code import address as address, function as function
from .views import (
    CACHE as CACHE,
    FILTERING as FILTERING,
    LAWS as LAWS,
    MODES as MODES,
    PASS as PASS,
    REAL as REAL,
    REALS as REALS,
    SYSTEM as SYSTEM,
    WHOLE as WHOLE,
    WHOLES as WHOLES,
)
