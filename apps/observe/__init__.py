"""Observability of a process: metrics, structured logs."""
