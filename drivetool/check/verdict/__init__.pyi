from .exhibits import candidates_of as candidates_of, worst as worst
from .rules import RULES as RULES, UNEXPLAINED as UNEXPLAINED, judged as judged
from .sentence import experiment_of as experiment_of, sentence_of as sentence_of
from .size import sizes_of as sizes_of
from .story import tell as tell
