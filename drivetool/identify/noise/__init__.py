"""The noise model of the innovations fit.

A problem comes in. The likelihood, noise parameters by scoring, and the fit under frozen extended-Kalman gains go
out.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
