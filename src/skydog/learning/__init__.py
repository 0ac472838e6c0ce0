"""How a skill is learnt: lessons, learners, and the training loop."""
