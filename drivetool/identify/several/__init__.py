"""Several recordings or results of one machine.

Experiments or estimates come in. Cross-tables of structures, differences between recordings, and one drive from
both of its motors go out.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
