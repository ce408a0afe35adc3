"""What a dataset covers (`numbers`, of its `runs`), as a `report` and a `page`; `summary` says what it holds."""
