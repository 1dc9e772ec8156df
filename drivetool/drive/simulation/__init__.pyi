from .augment import plant_of as plant_of
from .simulate import Filtered as Filtered, ObserverGains as ObserverGains, Plant as Plant, Trace as Trace
