"""Cable simulators behind one contract."""
