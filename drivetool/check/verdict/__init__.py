"""Turns a finished search into a diagnosis.

Facts, the table of rules, sentence, sizes, experiment and plot data make one diagnosis. It runs no search.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
