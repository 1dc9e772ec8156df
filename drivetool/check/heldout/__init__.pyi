from .between_records import (
    Change as Change,
    change_between as change_between,
    finding_of as finding_of,
    told_apart as told_apart,
)
from .folds import blocks_of as blocks_of
from .free_run_error import (
    Forecast as Forecast,
    blocks_under_test as blocks_under_test,
    exact as exact,
    forecast as forecast,
    gain_by_blocks as gain_by_blocks,
    gain_of as gain_of,
    unexplained_percent as unexplained_percent,
)
from .noise_run import error_by_noise as error_by_noise
from .samples import Split as Split, split_of as split_of
from .scores import (
    LOOKS as LOOKS,
    ONE_OFF as ONE_OFF,
    Fold as Fold,
    Score as Score,
    extended as extended,
    folds_of as folds_of,
    in_one_place as in_one_place,
    lead_in_blocks as lead_in_blocks,
    price_of as price_of,
    score as score,
    total_evidence as total_evidence,
)
