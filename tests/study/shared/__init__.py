"""What the studies have in common.

options  environment variables, and the results file of the code as it is now
rows     records to make, and their rows in a results file, resumable
command  `drivetool greybox` on a record in this process, and what it says
figures  shares, quantiles and ratios with their intervals
tables   the printed tables
"""
