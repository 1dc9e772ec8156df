from .job_sentences import Told as Told, told as told
from .manifest import (
    HEAD as HEAD,
    NAME as NAME,
    PAGE as PAGE,
    SUMMARY as SUMMARY,
    TABLE as TABLE,
    TRENDS as TRENDS,
    Manifest as Manifest,
    open_manifest as open_manifest,
    read_manifest as read_manifest,
)
from .summary import (
    FIT as FIT,
    Entry as Entry,
    rows as rows,
    summary_csv as summary_csv,
    summary_parquet as summary_parquet,
)
