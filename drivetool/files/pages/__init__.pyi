from .report_page import diagnosis_page as diagnosis_page
from .report_style import CSS as CSS
