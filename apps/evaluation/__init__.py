"""What an evaluation leaves behind to be looked at: films, a report, a gallery of failures."""
