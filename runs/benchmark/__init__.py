"""The open benchmark: suites of scenes and tasks as data, and folders with the results of drivers in them."""
