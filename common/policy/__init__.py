"""Run-time of an exported policy."""
