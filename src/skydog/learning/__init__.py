"""How a skill is learnt: lessons, learners and the one loop that joins them."""
