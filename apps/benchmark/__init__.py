"""The open benchmark: drives suites, verifies and packs results, and writes the table of drivers."""
