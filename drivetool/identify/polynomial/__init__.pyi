from .data import data_of as data_of
from .pem_figures import figures_of as figures_of
from .pem_fit import PemFit as PemFit, fit_structure as fit_structure
from .pem_model import KINDS as KINDS, Structure as Structure
from .realise import (
    conversion as conversion,
    lines_of as lines_of,
    ringing as ringing,
    ringing_with_std as ringing_with_std,
)
from .structures import NOISE_ORDER as NOISE_ORDER, simulated_fit as simulated_fit, structured as structured
