"""What was measured, as values: a recording as it was logged, and the experiment that every step gets.

The roles of channels and their units say what its numbers mean. Its packages lead from a file to an experiment.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
