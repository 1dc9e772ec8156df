from .absence import law_of as law_of, needs_of as needs_of, why_absent as why_absent
from .decision import Decision as Decision, decide as decide
from .result import Base as Base, Found as Found, Searched as Searched, fitted_to_all as fitted_to_all
from .run_search import look as look
from .search import Search as Search
from .shaft_scale import likelier_so as likelier_so, scale_beside as scale_beside
