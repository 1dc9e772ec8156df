from .estimator import backlash as backlash, valleys as valleys
