from .plot_style import (
    BLUE as BLUE,
    GREY as GREY,
    INK as INK,
    ORANGE as ORANGE,
    RED as RED,
    stacked_panels as stacked_panels,
)
from .plots import draw_all as draw_all, recording_plot as recording_plot
from .report_figures import svg as svg
