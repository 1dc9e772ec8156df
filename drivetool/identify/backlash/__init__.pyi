from .estimator import MAX_GAP_STARTS as MAX_GAP_STARTS, backlash as backlash, local_minima as local_minima
