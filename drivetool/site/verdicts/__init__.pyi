from .bars import judge as judge
from .cases import Case as Case, junit as junit, markdown as markdown
from .overview_page import index_page as index_page
