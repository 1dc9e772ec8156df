"""Two-mass drives of which the model lacks a law: how far each criterion errs, and whether it says so.

machine     random drives: those of the one-body study, cut in two by a shaft
laws        the missing laws on either body, the gap, the third mass
kernel      the simulator
record      a record and its truth, by situation, size and number
estimators  the command line on one record
runner      which records there are, and their rows
scores      errors and coverage, from rows
tables      the printed tables
"""
