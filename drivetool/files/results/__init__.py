"""Takes what a step returned and gives the file that it writes: estimate, validation, diagnosis, gains, spectra,
comparison, inspection, Parquet tables.

Gains and bases of a diagnosis are read back here.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
