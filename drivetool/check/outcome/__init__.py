"""The options and the result of a diagnosis: rounds, candidates, gain, facts and verdict.

Plain values without any computation of a fit; every other package of check may use them.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
