"""The real arm: a UR controller driven over the network, behind the Rig contract."""
