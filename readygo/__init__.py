"""readygo: from a Gaussian scene of a real place to navigation data with moving people, and to robot policies."""

__version__ = "0.1.0"
