from .absence import law_of as law_of, needs_of as needs_of, why_absent as why_absent
from .candidate_fit import CandidateFit as CandidateFit
from .candidate_report import tested_state as tested_state
from .decision import Decision as Decision, decide as decide
from .result import (
    Base as Base,
    SearchResult as SearchResult,
    SelectedCauses as SelectedCauses,
    fitted_to_all as fitted_to_all,
)
from .run_search import search_causes as search_causes
from .search import ForwardSelection as ForwardSelection
from .shaft_scale import (
    joint_shaft_scale as joint_shaft_scale,
    scale_improves_likelihood as scale_improves_likelihood,
)
