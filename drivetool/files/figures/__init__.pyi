from .panels import Mark as Mark, Panel as Panel, mark as mark, picture as picture
from .plot_style import BLUE as BLUE, GREY as GREY, INK as INK, ORANGE as ORANGE, RED as RED
from .plots import draw_all as draw_all, recording_plot as recording_plot, svg as svg
