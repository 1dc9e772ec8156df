from .full_diagnosis import diagnose as diagnose
