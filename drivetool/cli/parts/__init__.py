"""What commands share or do with another kind of input: the run of an estimator, replays of gains, coast-downs,
swaps of parameters.

Each takes a job and delivers like its command.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
