from .design import tune as tune
from .gains import Design as Design, Gains as Gains, Ratings as Ratings, TuneOptions as TuneOptions
from .pictures import (
    Frequencies as Frequencies,
    GainTimeMap as GainTimeMap,
    LimitCyclePlotData as LimitCyclePlotData,
    LoadStep as LoadStep,
    SpreadPicture as SpreadPicture,
)
from .remarks import gain_unit as gain_unit
