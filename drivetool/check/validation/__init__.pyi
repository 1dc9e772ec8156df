from .coast_down_validation import CoastDownModel as CoastDownModel, validate_coast_down as validate_coast_down
from .free_run_validation import validate as validate
from .model_run import ModelRun as ModelRun, run_model as run_model
from .result import ValidateOptions as ValidateOptions, Validation as Validation
from .sections import CheckSection as CheckSection
from .torque_validation import validate_torque as validate_torque
