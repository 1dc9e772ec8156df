"""Many recordings of many machines: takes a site file and the command line that does its steps, and gives results,
summary, trends, verdicts and a page.

What is done stays done.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
