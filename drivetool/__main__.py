"""`python -m drivetool`, where the command itself is not on the path."""

from drivetool.cli.main import run

if __name__ == "__main__":
    run()
