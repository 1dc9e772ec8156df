from . import numba_private as numba_private
from .compiled import APART as APART, COMPILE as COMPILE, HOT as HOT, LAW as LAW, unit as unit
from .machine_code import address as address, function as function, store as store, symbol as symbol
from .numba_private import kept_in_folder as kept_in_folder, leave_to_the_end as leave_to_the_end
from .views import (
    CACHE as CACHE,
    FILTERING as FILTERING,
    LAWS as LAWS,
    PASS as PASS,
    REAL as REAL,
    REALS as REALS,
    SYSTEM as SYSTEM,
    WHOLE as WHOLE,
    WHOLES as WHOLES,
)
