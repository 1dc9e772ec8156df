from .estimator import (
    Run as Run,
    SpectraOptions as SpectraOptions,
    output_role as output_role,
    reference_of as reference_of,
    spectra as spectra,
    stretches_of as stretches_of,
)
from .frequency_fit import (
    MAX_CHI_SQUARE as MAX_CHI_SQUARE,
    LineProblem as LineProblem,
    greybox_by_frequency as greybox_by_frequency,
    line_weights as line_weights,
    noise_covariance as noise_covariance,
    sandwich as sandwich,
)
from .frf import Response as Response, Welch as Welch, welch_response as welch_response
from .sections import DistortionSection as DistortionSection, PeakSection as PeakSection
from .spectra_findings import MIN_COHERENCE as MIN_COHERENCE
from .spectrum import Spectrum as Spectrum
