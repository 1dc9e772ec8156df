"""Takes the words of a command line, and leaves with an exit code.

All commands stand under their names in one file; nothing heavy is imported until a command runs.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
