from .assemble import COLUMN_MULTIPLE as COLUMN_MULTIPLE, Assembly as Assembly, Law as Law, Layout as Layout
from .chain import (
    END_MASS as END_MASS,
    KNOWN_DRIVES as KNOWN_DRIVES,
    DampingLaw as DampingLaw,
    Drive as Drive,
    one_body as one_body,
    two_mass as two_mass,
)
from .dual import Dual as Dual
from .effects.catalogue import GEAR_RATIO_EXPONENTS as GEAR_RATIO_EXPONENTS, TOTALS as TOTALS
from .effects.torque_constant import is_constant as is_constant
from .linearise import (
    MOTOR_TORQUE as MOTOR_TORQUE,
    chain_alone as chain_alone,
    linear_drive as linear_drive,
    resonances as resonances,
    state_space as state_space,
)
from .supply_vector import (
    by_converter as by_converter,
    by_phases as by_phases,
    vector_frequency as vector_frequency,
    vector_of_converter as vector_of_converter,
    vector_of_phases as vector_of_phases,
)
