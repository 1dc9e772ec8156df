from .code import Severity as Severity
from .registry import CODES as CODES, DOUBTING as DOUBTING, SHIFTED as SHIFTED, STAGES as STAGES, SUMMED as SUMMED
from .renamed import RENAMED as RENAMED
