"""Loads of joints: envelopes, rating lives of bearings, bushings, balance of rotors, and sets of loads for FEM."""
