"""Pictures of responses: nothing is drawn where no line was excited, and records are distinguishable."""

import numpy as np

from drivetool.files.figures.plot_kinds import figure
from drivetool.identify.estimate import PlotData


def drawn(kind, curves):
    return figure(PlotData(kind, "a title " * 15, "frequency [Hz]", "magnitude [rad/s/Nm]", curves)).axes


def test_no_line_is_drawn_across_empty_lines():
    hz = np.r_[np.arange(1.0, 10.0), np.arange(14.0, 20.0)]
    y = 1.0 / hz
    axes = drawn("response", {"magnitude": (hz, y), "band low": (hz, 0.9 * y), "band high": (hz, 1.1 * y),
                              "phase": (hz, -y), "coherence": (hz, np.ones_like(hz))})
    (line,) = [x for x in axes[0].lines if x.get_label() == "magnitude"]
    x = line.get_xdata()
    assert np.isnan(x).sum() == 1 and x[8] == 9.0 and x[10] == 14.0
    assert len(axes[0].collections[0].get_paths()) == 2
    assert axes[1].lines[0].get_linestyle() == "None"
    assert "\n" in axes[0].figure.get_suptitle()


def test_the_curve_of_a_model_is_whole():
    hz = np.geomspace(1.0, 100.0, 50)
    axes = drawn("response", {"magnitude": (hz, 1.0 / hz), "phase": (hz, -hz)})
    assert np.isfinite(axes[0].lines[0].get_xdata()).all() and axes[1].lines[0].get_linestyle() == "-"


def test_records_have_colours_of_their_own():
    hz = np.geomspace(1.0, 100.0, 50)
    (axis,) = drawn("bode", {name: (hz, k / hz) for k, name in enumerate(("one", "two", "three"), 1)})
    assert len({line.get_color() for line in axis.lines}) == 3


def test_a_ratio_beyond_three_stands_out_and_every_name_is_written():
    (axis,) = drawn("ratios", {"motor.inertia": (np.array([-0.5]), np.array([0.0])),
                               "load.inertia": (np.array([8.0]), np.array([-1.0]))})
    assert [tick.get_text() for tick in axis.get_yticklabels()] == ["motor.inertia", "load.inertia"]
    within, beyond = (line for line in axis.lines if line.get_marker() == "o")
    assert within.get_color() != beyond.get_color()
