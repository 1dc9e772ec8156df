"""The channel map from its YAML file."""

from __future__ import annotations

from pathlib import Path

from drivetool.errors import BadOption, BadParameters
from drivetool.files.yaml.text import from_yaml
from drivetool.logs.channels import ChannelMap


def load_channel_map(path: str | Path | None) -> ChannelMap | None:
    """Read a channel map.

    path     of the YAML file; None: no map
    returns  ChannelMap, or None
    raises   BadParameters: a file that cannot be read or used
    """
    if path is None:
        return None
    try:
        content = from_yaml(Path(path).read_bytes(), Path(path).name)
    except OSError as error:
        raise BadParameters(f"to read the channel map {path}", error.strerror or str(error),
                            "Check the path given with --map.") from None
    try:
        return ChannelMap.from_mapping(content, Path(path).name)
    except BadOption as error:  # what is wrong is the file's content, not the command's words
        raise BadParameters(error.wanted, error.found, error.do, error.available) from None
