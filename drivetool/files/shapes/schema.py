"""JSON Schemas of all files, made from the types: `python -m drivetool.files.shapes.schema schemas`."""

from __future__ import annotations

import inspect
import json
import sys
from pathlib import Path

import msgspec

from drivetool.files.disk import write_whole
from drivetool.files.shapes import analysis_shapes, parameter_shapes as shapes
from drivetool.files.shapes.gains_shapes import GainsFile
from drivetool.files.shapes.inspection_shapes import InspectionFile
from drivetool.files.shapes.site_shapes import SiteFile
from drivetool.files.shapes.trend_shapes import TrendsFile
from drivetool.logs.channels import ChannelMapFile

SCHEMA_TITLES = {
    "parameters": "drivetool parameter file",
    "validation": "drivetool validation file",
    "gains": "drivetool gains file",
    "channel-map": "drivetool channel map",
    "inspection": "drivetool inspection of a log",
    "spectra": "drivetool spectra file",
    "comparison": "drivetool comparison file",
    "trends": "drivetool trends file",
    "site": "drivetool site file",
}


def file_types() -> dict[str, type]:
    """Kind of file -> its type, as in SCHEMA_TITLES."""
    return {"parameters": shapes.ParameterFile, "validation": shapes.ValidationFile,
            "channel-map": ChannelMapFile, "inspection": InspectionFile, "spectra": analysis_shapes.SpectraFile,
            "comparison": analysis_shapes.ComparisonFile, "gains": GainsFile, "site": SiteFile,
            "trends": TrendsFile}


def schemas() -> dict[str, str]:
    """File name -> JSON Schema text, sorted."""
    return {f"{name}.json": _schema_text(SCHEMA_TITLES[name], shape) for name, shape in file_types().items()}


def schema_of(shape: type) -> dict:
    """JSON Schema of a type of file; of several types one may have, null comes last."""
    return _stable_order(msgspec.json.schema(shape))


def _stable_order(node):
    """Versions of msgspec list the types of a value in orders of their own, and indent what is described or not."""
    if isinstance(node, list):
        return [_stable_order(each) for each in node]
    if not isinstance(node, dict):
        return node
    node = {key: _stable_order(value) for key, value in node.items()}
    if "anyOf" in node:
        node["anyOf"] = sorted(node["anyOf"], key=lambda one: (one.get("type") == "null", json.dumps(one)))
    if isinstance(node.get("description"), str):
        node["description"] = inspect.cleandoc(node["description"])
    return node


def _schema_text(title: str, shape: type) -> str:
    """One schema with its title at the top."""
    schema = {"$schema": "https://json-schema.org/draft/2020-12/schema", "title": title, **schema_of(shape)}
    return json.dumps(schema, indent=2, sort_keys=True, ensure_ascii=True) + "\n"


def main(folder: str) -> None:
    """Write every schema into a folder."""
    for name, text in schemas().items():
        write_whole(Path(folder) / name, text)


if __name__ == "__main__":
    main(*sys.argv[1:])
