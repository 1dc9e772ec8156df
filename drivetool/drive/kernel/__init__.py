"""The compiled passes over a record: simulation and Kalman filter, exact from event to event, with sensitivities.

Tables of numbers come in, and motion with its sensitivities goes out. A process of its own compiles the passes
(`build`); Python reaches them by the addresses that the wing of compiling gives.
"""
