"""From recordings, a drive and the user's options to a problem with a first guess.

Experiments come in. Roles, start states, torque constants, the task and its outcome go out.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
