from .findings import trends_of as trends_of
from .trend import ALARM as ALARM
from .trend_picture import exhibits_of as exhibits_of
from .trends_result import summary_input as summary_input, trends_file as trends_file
