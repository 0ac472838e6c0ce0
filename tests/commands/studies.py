"""What every study must have written."""

import json

from skydog.study import claims, paper, scenarios


def assert_whole(out, results):
    assert json.loads((out / "results.json").read_text()) == json.loads(json.dumps(results))
    assert results["rows"].keys() == paper.SCENARIOS.keys()
    for name, row in results["rows"].items():
        assert row["n"] == 30
        assert row["random"]["cases"] == 1000
        assert row["paper"] == paper.PRINTED[name]
        assert row["verdict"] in ("reproduced", "better", "not reproduced")
        for cases in (row["ours"], row["random"]):
            for metric in ("steps", "distance", "cumulative_reward", "error_per_step", "turn"):
                low, high = cases[metric]["ci95"]
                assert low <= cases[metric]["mean"] <= high
    page, document = (out / "report.html").read_text(), (out / "reproduces.md").read_text()
    for told in (*paper.SCENARIOS, *(claim.title for claim in claims.CLAIMS)):
        assert told in page
        assert told in document
    assert "{{" not in page
    for figure in ("learning_curves", "learning_curves_paper", "trajectories", "transfer"):
        assert (out / f"{figure}.png").stat().st_size > 10_000
    assert {path.stem for path in (out / "traces").iterdir()} == set(scenarios.SHOWN)
