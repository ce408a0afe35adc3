"""GNM, ViNT and NoMaD: the published navigation networks, for the weights that their authors offer.

Written from the papers and the shapes of the published weights; names of parts are those of the weights.
Source: Shah et al., GNM (ICRA 2023) and ViNT (CoRL 2023); Sridhar et al., NoMaD (ICRA 2024).
"""

LOOK_HZ = 4
"""How often the networks look and decide [Hz]; the unit of their places is the way in between at full speed."""
