"""A second driver, for the tests: an arm that follows its path by a clock of its own."""
