from .between_records import (
    Change as Change,
    change_between as change_between,
    finding_of as finding_of,
    records_differ_text as records_differ_text,
)
from .folds import blocks_of as blocks_of
from .free_run_error import (
    FreeRuns as FreeRuns,
    blocks_under_test as blocks_under_test,
    exact_to_rounding as exact_to_rounding,
    gain_by_blocks as gain_by_blocks,
    gain_of as gain_of,
    held_out_free_runs as held_out_free_runs,
    unexplained_percent as unexplained_percent,
)
from .parametric_bootstrap import error_by_noise as error_by_noise
from .samples import Split as Split, split_of as split_of
from .scores import (
    EVENT_TIMES as EVENT_TIMES,
    SCANNED_VALUES as SCANNED_VALUES,
    Fold as Fold,
    Score as Score,
    folds_of as folds_of,
    gain_in_one_block as gain_in_one_block,
    lead_in_blocks as lead_in_blocks,
    log_scanned_values as log_scanned_values,
    over_all_records as over_all_records,
    score as score,
    total_evidence as total_evidence,
)
