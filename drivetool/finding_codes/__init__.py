"""The registry of finding codes: the code of a finding comes in; its meaning, and what to do, go out.

One table per stage of the work. The reference pages print it, and `finding.Finding` refuses a code that it lacks.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
