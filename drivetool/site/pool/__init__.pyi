from .dask_cluster import cluster as cluster
from .executor import (
    UNREAD as UNREAD,
    Executor as Executor,
    NumberedTasks as NumberedTasks,
    Runner as Runner,
    all_at_once as all_at_once,
)
from .pool import Limits as Limits, Pool as Pool, check_memory_limit as check_memory_limit
from .worker import library_versions as library_versions
