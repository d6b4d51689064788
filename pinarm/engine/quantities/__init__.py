"""Named quantities of states and motions: coordinates, bodies, joints, reactions, energies."""
