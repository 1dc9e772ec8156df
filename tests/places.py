"""Where the project's files lie, for tests that read them."""

from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
FIXTURES = ROOT / "fixtures"
RIG = FIXTURES / "rig"
SCHEMAS = ROOT / "schemas"
