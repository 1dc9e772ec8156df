from . import field_path as field_path
from .channel_map import (
    SCHEMA as SCHEMA,
    ChannelMap as ChannelMap,
    ChannelMapFile as ChannelMapFile,
    RoleEntry as RoleEntry,
    TimeEntry as TimeEntry,
    choose_channels as choose_channels,
    resolve_channel as resolve_channel,
)
from .convert import in_si as in_si, shared_units as shared_units, to_signals as to_signals
from .field_path import Path as Path, Selector as Selector, find as find
from .reader import Choose as Choose, Reader as Reader
from .time_numbers import (
    as_seconds as as_seconds,
    require_time_resolution as require_time_resolution,
    unwrap_counter as unwrap_counter,
)
