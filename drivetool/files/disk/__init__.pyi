from .folders import RECORDING_SUFFIXES as RECORDING_SUFFIXES, recordings_in as recordings_in
from .write import (
    check_folder as check_folder,
    check_target as check_target,
    encoded as encoded,
    make_folder as make_folder,
    write_whole as write_whole,
)
