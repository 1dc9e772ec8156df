"""From recordings of electric drives to parameters with honest uncertainties."""

__version__ = "0.2.0"
