"""Many recordings of many machines: takes a site file and the command line that runs its steps, and gives results,
summary, trends, verdicts and a page.

A later run repeats only what has changed.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
