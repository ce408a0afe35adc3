"""The installed package: puts the folder that holds `common`, `services` and `apps` on the path."""
