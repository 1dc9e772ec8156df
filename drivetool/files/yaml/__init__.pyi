from . import checked as checked, units as units
from .channel_map_file import load_channel_map as load_channel_map
from .parameter_file import (
    Loaded as Loaded,
    load_parameters as load_parameters,
    load_result as load_result,
    read_bytes as read_bytes,
)
from .ratios import (
    coast_down_model as coast_down_model,
    fitted_flux_decay as fitted_flux_decay,
    has_only_ratios as has_only_ratios,
    is_coast_down_file as is_coast_down_file,
)
from .stated_drive import StatedDrive as StatedDrive
from .text import (
    counted_noun as counted_noun,
    escape_unprintable as escape_unprintable,
    first_of as first_of,
    from_yaml as from_yaml,
    to_json as to_json,
    to_plain as to_plain,
    to_yaml as to_yaml,
    written as written,
)
from .units import torque_over_input as torque_over_input
