from .augment import plant_of as plant_of
from .simulate import Filtered as Filtered, Gains as Gains, Plant as Plant, Trace as Trace
