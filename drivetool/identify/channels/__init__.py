"""Tests of the channels that a fit uses: suspect signs and units, outliers, a torque logged late, unused roles,
feedback.

A task or outcome comes in. Findings, or samples to leave out, go out.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
