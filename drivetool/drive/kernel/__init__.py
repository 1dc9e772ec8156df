"""The compiled passes over a record: simulation and Kalman filter, exact from event to event, with sensitivities.

No Python imports it: it is reached by the addresses that the wing of compiling gives.
"""
