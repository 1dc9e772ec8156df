"""What a record identifies.

An outcome comes in. Jointly identified parameters, a resonance without evidence, a contradicted held value, a
one-sided gap and a profile likelihood go out.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
