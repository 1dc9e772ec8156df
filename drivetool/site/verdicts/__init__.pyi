from .bars import evaluate_bars as evaluate_bars
from .cases import Case as Case, junit as junit, markdown as markdown
from .overview_page import index_page as index_page
