"""Which candidate the default fit of a record takes, and which laws the drive lacks.

Outcomes of rival fits come in. The chosen candidate, the structural part of its uncertainty and the laws go out.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
