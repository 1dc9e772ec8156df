"""Simulated drives to compare drivetool with; shares no code with it."""
