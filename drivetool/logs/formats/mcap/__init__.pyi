from .read import read_mcap as read_mcap
