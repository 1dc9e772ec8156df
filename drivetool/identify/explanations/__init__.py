"""The explanations of a record between which the default fit chooses, see docs/explanation/default-fit.md."""
