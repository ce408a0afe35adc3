"""Training of the published networks GNM, ViNT and NoMaD on recorded episodes, as their authors train them."""
