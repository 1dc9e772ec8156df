from .free_run_validation import validate as validate
from .model_run import ModelRun as ModelRun, run_model as run_model
from .result import RecordCheck as RecordCheck, ValidateOptions as ValidateOptions, Validation as Validation
from .run_down_validation import Model as Model, validate_run_down as validate_run_down
from .torque_validation import validate_torque as validate_torque
