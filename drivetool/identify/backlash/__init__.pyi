from .estimator import backlash as backlash, local_minima as local_minima
