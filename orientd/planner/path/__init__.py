"""The geometry of a motion: curves laid end to end in time, with the position that goes along."""
