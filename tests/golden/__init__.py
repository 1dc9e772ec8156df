"""What a user gets from two commits, on the same inputs, compared: `make golden BASE=COMMIT`.

The commands run as processes, so that nothing here knows how the product is built. Inputs, environment, sources and
results lie in build/golden, or in the folder that DRIVETOOL_GOLDEN names:

    env/        the one environment, from lock.txt
    trees/      the sources of a commit, and a `drivetool` that runs them
    inputs/     files that the commands read, named by their content
    results/    COMMIT-HASH/CASE-HASH.zip: exit codes, standard output and all files written, of one case; the
                first hash is of the lock, the variables of the environment and the processor
"""
