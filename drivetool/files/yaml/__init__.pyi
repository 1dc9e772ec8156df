from . import checked as checked, units as units
from .channel_map_file import load_channel_map as load_channel_map
from .parameter_file import (
    Loaded as Loaded,
    load_parameters as load_parameters,
    load_result as load_result,
    read_bytes as read_bytes,
)
from .ratios import (
    flux_decay as flux_decay,
    of_coast_down as of_coast_down,
    only_ratios as only_ratios,
    run_down_model as run_down_model,
)
from .text import (
    from_yaml as from_yaml,
    plain as plain,
    several as several,
    to_json as to_json,
    to_yaml as to_yaml,
    visible as visible,
)
from .units import torque_over_input as torque_over_input
