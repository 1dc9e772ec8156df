from .estimator import blackbox as blackbox, transfer_function as transfer_function
