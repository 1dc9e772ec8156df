from .dask_cluster import cluster as cluster
from .executor import UNREAD as UNREAD, Executor as Executor, Numbered as Numbered, Runner as Runner, once as once
from .pool import Limits as Limits, Pool as Pool, check_memory_limit as check_memory_limit
from .worker import numerics as numerics
