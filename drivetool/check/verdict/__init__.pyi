from .diagnosis_report import diagnosis_of as diagnosis_of
from .plot_data import candidate_plots as candidate_plots, worst_interval as worst_interval
from .rules import MIN_UNEXPLAINED_GAIN as MIN_UNEXPLAINED_GAIN, RULES as RULES, apply_rules as apply_rules
from .sentence import experiment_of as experiment_of, sentence_of as sentence_of
from .size import sizes_of as sizes_of
