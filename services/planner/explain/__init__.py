"""Why the expert did what it did.

The way through: `journal` notes what it knew and intended at every step; `moments` picks the few that explain a run;
`numbers` says it in figures; `picture` draws it from `picture_layers`, one of them the `wedge` of its sight.
"""
