from .batch import run as run
from .batch_request import BatchRequest as BatchRequest, CommandLine as CommandLine
