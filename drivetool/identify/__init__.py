"""The estimators: experiments, a drive and options come in; an estimate with its uncertainty goes out.

First the method, in the order of its imports: problem, estimate, noise, setup, starts, channels, motion, fit,
identifiability, laws, outcome. Then the steps on it: frequency, polynomial, plateaus, shaft_torque, inverse,
greybox, backlash, blackbox, acceleration, coast_down, steady, several.
"""
