"""Takes a finished search and says what it means.

Facts, the table of rules, sentence, sizes, experiment and exhibits come out as one diagnosis. It runs no search.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
