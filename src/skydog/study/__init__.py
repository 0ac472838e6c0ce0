"""How good a shepherd is: cases, metrics, statistics, the paper's own numbers, the report."""
