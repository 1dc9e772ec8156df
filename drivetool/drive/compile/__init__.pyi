from . import numba_private as numba_private
from .compiled import (
    COMPILE as COMPILE,
    COMPILE_LAW as COMPILE_LAW,
    INLINED as INLINED,
    NO_OVERLAP as NO_OVERLAP,
    as_unit as as_unit,
)
from .lowered import ARCHIVES as ARCHIVES, text_of as text_of, write_archive as write_archive
from .machine_code import (
    COMPILED_WITH as COMPILED_WITH,
    address as address,
    function as function,
    only_compiler as only_compiler,
    store as store,
    symbol as symbol,
)
from .numba_private import cached_in_folder as cached_in_folder, defer_code_generation as defer_code_generation
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
