"""One-body drives of which the model lacks a law: how far each estimator errs, and whether it says so.

machine     random drives, from a servo of 20 W to a mill of 2 MW
laws        the thirteen missing laws, their constants and their share of the friction curve
kernel      the simulator
excitation  torque commands and references
record      a record and its truth, by law, size and number
regression  plain least squares, for comparison
estimators  the command line and the regression on one record
runner      which records there are, and their rows
scores      errors and coverage, from rows
tables      the printed tables
"""
