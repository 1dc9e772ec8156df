from .alarm import DEFAULT_ALARM_RATIO as DEFAULT_ALARM_RATIO
from .findings import trends_of as trends_of
from .trend_picture import trend_plots as trend_plots
from .trends_result import summary_input as summary_input, trends_file as trends_file
