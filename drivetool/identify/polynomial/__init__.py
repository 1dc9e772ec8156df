"""Discrete-time polynomial models: oe, bj, arx, armax, innovations.

Runs of torque and speed come in. Poles, notches and resonances with intervals, and a chain of inertias and
stiffnesses go out.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
