"""The paper's learning: models of landings, fine-tuning, and policies that plan with them."""
