"""Simulated drives to hold drivetool against; shares no code with it."""
