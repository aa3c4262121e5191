"""Twin: a UR controller in software, which speaks the maker's protocols on this computer only."""
