from .data import data_of as data_of
from .pem_figures import figures_of as figures_of
from .pem_fit import PemFit as PemFit, fit_structure as fit_structure
from .pem_model import KINDS as KINDS, Structure as Structure
from .realise import (
    chain_parameters as chain_parameters,
    conversion as conversion,
    ringing_frequencies as ringing_frequencies,
    ringing_frequencies_with_std as ringing_frequencies_with_std,
)
from .structures import (
    DEFAULT_NOISE_ORDER as DEFAULT_NOISE_ORDER,
    polynomial_blackbox as polynomial_blackbox,
    simulated_fit as simulated_fit,
)
