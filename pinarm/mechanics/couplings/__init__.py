"""Couplings: linear relations ``sum_i w_i q_i = c`` between joint coordinates, and the forces that hold them."""
