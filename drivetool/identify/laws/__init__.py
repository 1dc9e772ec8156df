"""Which explanation of a record the default fit takes, and which laws the drive lacks.

Outcomes of rival fits come in. The explanation, its structure part of the uncertainty and the laws found go out.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
