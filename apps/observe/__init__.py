"""What a process shows of itself: metrics, structured logs, traces."""
