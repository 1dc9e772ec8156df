from .assemble import PAD as PAD, Assembly as Assembly, Law as Law, Layout as Layout
from .chain import (
    AT as AT,
    GEARED as GEARED,
    KNOWN_DRIVES as KNOWN_DRIVES,
    TIP as TIP,
    TOTALS as TOTALS,
    DampingLaw as DampingLaw,
    Drive as Drive,
    is_constant as is_constant,
    one_body as one_body,
    shared as shared,
    two_mass as two_mass,
)
from .dual import Dual as Dual
from .linearise import MOTOR as MOTOR, closed as closed, resonances as resonances, state_space as state_space
from .shaft_rows import closed_shaft as closed_shaft, in_contact as in_contact
from .supply_vector import (
    by_converter as by_converter,
    by_phases as by_phases,
    turning as turning,
    vector_of_converter as vector_of_converter,
    vector_of_phases as vector_of_phases,
)
