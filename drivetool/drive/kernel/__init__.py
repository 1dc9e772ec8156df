"""The compiled passes over a record: simulation and Kalman filter, exact from event to event, with sensitivities.

The input is tables of numbers, the output is the motion with its sensitivities. A separate process compiles the
passes (drivetool.drive.compile.build); Python calls them by the addresses that drivetool.drive.compile provides.
"""
