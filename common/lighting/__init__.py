"""Light of a scene where humans walk: probes of it, and how it falls on surfaces."""
