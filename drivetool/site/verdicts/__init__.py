"""Takes results and the bars of the site file, and gives a case per bar and recording.

JUnit, Markdown and the page of the site are written from them.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
