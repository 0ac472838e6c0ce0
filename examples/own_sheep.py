"""Your own sheep: a flock that does not hold together, and what that does to its shepherds."""

import equinox as eqx

import skydog
from skydog.study import evaluate
from skydog.study.cases import cases


def main(count: int = 200) -> dict[str, dict[str, dict]]:
    """Fly two shepherds through the same starts with two flocks; return the rows of figures."""
    world = skydog.preset("paper", arena=4.0)
    flocks = {
        "cohesive, as in the paper": world,
        # A world is a pytree; eqx.tree_at gives a copy in which one number is another.
        "without grouping": eqx.tree_at(lambda w: w.flock.grouping, world, 0.0),
    }
    shepherds = {"strombom": skydog.Strombom(), "h-ddpg-4x4": skydog.load("h-ddpg-4x4")}

    rows = {}
    print(f"{'flock':28}{'shepherd':12}{'success':>22}{'steps':>20}")
    for flock, sheep_live_here in flocks.items():
        starts = cases(sheep_live_here, count, starts="random", seed=1)
        for name, shepherd in shepherds.items():
            row = evaluate.row(evaluate.fly(sheep_live_here, shepherd, starts))
            rows.setdefault(flock, {})[name] = row
            low, high = row["success_ci95"]
            success = f"{row['success']:.1%} [{low:.1%}, {high:.1%}]"
            steps = row["steps"]
            took = f"{steps['mean']:.0f} [{steps['ci95'][0]:.0f}, {steps['ci95'][1]:.0f}]"
            print(f"{flock:28}{name:12}{success:>22}{took:>20}")
    return rows


if __name__ == "__main__":
    main()
