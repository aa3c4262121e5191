"""Rigs: one robot, real or virtual, that plays a motion and reports where the endpoint went."""
