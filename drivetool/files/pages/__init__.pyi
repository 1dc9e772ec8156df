from .rendering import rendered as rendered
from .report_page import diagnosis_page as diagnosis_page
