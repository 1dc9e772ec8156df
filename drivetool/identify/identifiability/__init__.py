"""What a record identifies.

An outcome comes in. What is identified only jointly, a resonance that is not shown, a held value that is
contradicted, a one-sided gap and a profile likelihood go out.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
