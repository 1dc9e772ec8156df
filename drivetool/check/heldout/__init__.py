"""Cross-validation: models on samples that they were not fitted to.

It gives scores, gains and evidence, free runs over held-out blocks, and a test whether held-out records differ.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
