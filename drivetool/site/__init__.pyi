from .asked import Asked as Asked, CommandLine as CommandLine
from .batch import run as run
