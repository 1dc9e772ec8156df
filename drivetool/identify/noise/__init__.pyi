from .innovations import (
    Fit as Fit,
    fit_innovations as fit_innovations,
    settle as settle,
    sought_everywhere as sought_everywhere,
    until_settled as until_settled,
)
from .log_noise import likely_noise as likely_noise
from .noise import (
    FAR as FAR,
    Noise as Noise,
    arrow as arrow,
    by_parabolas as by_parabolas,
    excerpt as excerpt,
    filtered as filtered,
    fit_ratio as fit_ratio,
    integrated as integrated,
    minus_log_likelihood as minus_log_likelihood,
    natural_ratio as natural_ratio,
    normal_under as normal_under,
    remembering as remembering,
    with_state as with_state,
    with_torque_noise as with_torque_noise,
)
