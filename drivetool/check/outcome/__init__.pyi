from .diagnosis import (
    IMPLAUSIBLE_NOISE_SHARE as IMPLAUSIBLE_NOISE_SHARE,
    LARGE_ERROR_TO_NOISE as LARGE_ERROR_TO_NOISE,
    LARGE_REMAINING_SHARE as LARGE_REMAINING_SHARE,
    OUTSIDE_CATALOGUE as OUTSIDE_CATALOGUE,
    CandidateResult as CandidateResult,
    DiagnoseOptions as DiagnoseOptions,
    Diagnosis as Diagnosis,
    Facts as Facts,
    Gain as Gain,
    Round as Round,
    noise_hides_law as noise_hides_law,
)
from .sections import (
    CandidateSection as CandidateSection,
    DiagnosisSection as DiagnosisSection,
    GainSection as GainSection,
    RoundSection as RoundSection,
    SizeSection as SizeSection,
    State as State,
)
