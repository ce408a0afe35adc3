"""Visual output of an evaluation: videos, a report, a gallery of failures."""
