"""What a diagnosis is asked, and what it returns: options, rounds, candidates, gain, facts and verdict.

Plain values without any computation of a fit; every other wing may use them.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
