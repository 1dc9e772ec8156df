"""From recordings of electric drives to parameters with honest uncertainties."""

__version__ = "0.1.0"
