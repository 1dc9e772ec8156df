from .manifest import (
    MANIFEST_FILE as MANIFEST_FILE,
    MANIFEST_FIRST_LINE as MANIFEST_FIRST_LINE,
    OVERVIEW_PAGE as OVERVIEW_PAGE,
    SUMMARY_CSV as SUMMARY_CSV,
    SUMMARY_PARQUET as SUMMARY_PARQUET,
    TRENDS_FILE as TRENDS_FILE,
    Manifest as Manifest,
    open_manifest as open_manifest,
    read_manifest as read_manifest,
)
from .step_result import StepResult as StepResult, step_result_of as step_result_of
from .summary import (
    FIT_FIGURE as FIT_FIGURE,
    Entry as Entry,
    summary_csv as summary_csv,
    summary_parquet as summary_parquet,
    summary_rows as summary_rows,
)
