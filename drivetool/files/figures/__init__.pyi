from .look import (
    BLUE as BLUE,
    GREY as GREY,
    INK as INK,
    ORANGE as ORANGE,
    RED as RED,
    stacked as stacked,
)
from .plots import draw_all as draw_all, exhibit_of as exhibit_of
from .report_figures import svg as svg
