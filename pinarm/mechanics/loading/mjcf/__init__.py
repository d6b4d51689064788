"""Reader of MJCF models, with the equalities that close loops."""
