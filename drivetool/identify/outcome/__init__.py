"""From an outcome of the engine to an Estimate.

Outcome, explanation and findings come in. Figures, intervals, the part that varies between recordings, findings and
pictures go out.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
