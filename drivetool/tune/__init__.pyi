from .design import tune as tune
from .gains import Design as Design, Gains as Gains, Ratings as Ratings, TuneOptions as TuneOptions
from .pictures import (
    Frequencies as Frequencies,
    LimitCyclePlotData as LimitCyclePlotData,
    LoadStep as LoadStep,
    Plane as Plane,
    SpreadPicture as SpreadPicture,
)
from .remarks import gain_unit as gain_unit
