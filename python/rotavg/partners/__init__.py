"""Measurement graphs and solutions as objects of other libraries, and back."""

from rotavg.partners.gtsam import from_gtsam, priors_from_gtsam, to_gtsam
from rotavg.partners.networkx import from_networkx, to_networkx

__all__ = ["from_gtsam", "from_networkx", "priors_from_gtsam", "to_gtsam", "to_networkx"]
