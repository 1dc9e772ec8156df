from .estimator import steady as steady
