from .build import open_experiment as open_experiment
from .inspect import Inspection as Inspection, inspect_log as inspect_log
from .sections import ChannelSection as ChannelSection
