from .explanation import Explanation as Explanation, explained as explained, told as told
from .foretold import FOLDS as FOLDS, GAIN as GAIN, MOST as MOST, foretelling as foretelling
from .influence import SLACK as SLACK, sandwich as sandwich, scores_of as scores_of, sized as sized
from .laws import PEAK as PEAK, Law as Law, library as library, model_error as model_error, weighty as weighty
from .left_out import can_be_asked as can_be_asked, lack_of as lack_of, without_shaft as without_shaft
from .own_parameters import nearest_line as nearest_line, within_bounds as within_bounds
from .third_mass import grown as grown, split_off as split_off, tip_names as tip_names
