"""`python -m drivetool`, where the command itself is not on the path."""

from drivetool.cli import run

if __name__ == "__main__":
    run()
