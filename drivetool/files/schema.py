"""JSON Schemas of all files, made from the types: `python -m drivetool.files.schema schemas`."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import msgspec

from drivetool.files import analysis_shapes, shapes
from drivetool.files.gains_shapes import GainsFile
from drivetool.files.write import write_whole

TITLES = {
    "parameters": "drivetool parameter file",
    "validation": "drivetool validation file",
    "gains": "drivetool gains file",
    "channel-map": "drivetool channel map",
    "inspection": "drivetool inspection of a log",
    "spectra": "drivetool spectra file",
    "comparison": "drivetool comparison file",
}


def kinds() -> dict[str, type]:
    """Kind of file -> its type, as in TITLES."""
    from drivetool.files.inspection import InspectionFile
    from drivetool.logs.channel_map import ChannelMapFile

    return {"parameters": shapes.ParameterFile, "validation": shapes.ValidationFile,
            "channel-map": ChannelMapFile, "inspection": InspectionFile, "spectra": analysis_shapes.SpectraFile,
            "comparison": analysis_shapes.ComparisonFile, "gains": GainsFile}


def schemas() -> dict[str, str]:
    """File name -> JSON Schema text, sorted."""
    return {f"{name}.json": _text(TITLES[name], shape) for name, shape in kinds().items()}


def _text(title: str, shape: type) -> str:
    """One schema with its title at the top."""
    schema = {"$schema": "https://json-schema.org/draft/2020-12/schema", "title": title,
              **msgspec.json.schema(shape)}
    return json.dumps(schema, indent=2, sort_keys=True, ensure_ascii=True) + "\n"


def main(folder: str) -> None:
    """Write every schema into a folder."""
    for name, text in schemas().items():
        write_whole(Path(folder) / name, text)


if __name__ == "__main__":
    main(*sys.argv[1:])
