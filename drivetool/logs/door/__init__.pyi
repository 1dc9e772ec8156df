from .build import open_experiment as open_experiment
from .inspect import ChannelReport as ChannelReport, Inspection as Inspection, inspect_log as inspect_log
