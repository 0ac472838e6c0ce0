"""What every study must have written."""

import json

from skydog.study import claims, paper, scenarios, verdict


def assert_whole(out, results):
    assert json.loads((out / "results.json").read_text()) == json.loads(json.dumps(results))
    assert results["rows"].keys() == paper.SCENARIOS.keys()
    for name, row in results["rows"].items():
        assert row["n"] == 30
        assert row["random"]["cases"] == 1000
        assert row["paper"] == paper.PRINTED[name]
        assert set(row["verdicts"].values()) <= {"better", "compatible", "worse"}
        assert row["verdict"] == verdict.verdict(row["verdicts"])
        for cases in (row["ours"], row["random"]):
            for metric in ("steps", "distance", "cumulative_reward", "error_per_step", "turn"):
                low, high = cases[metric]["ci95"]
                assert low <= cases[metric]["mean"] <= high
    assert results["robustness"].keys() == {"goals", "starts", "flocks", "noise"}
    for rows in results["robustness"].values():
        for cells in rows.values():
            for cell in cells.values():
                low, high = cell["success_ci95"]
                assert low <= cell["success"] <= high
                assert cell["failed"] == round((1.0 - cell["success"]) * cell["cases"])
    for name in ("Strombom-4x4", "H-DDPG-6x6"):
        assert results["rows"][name]["times_best"]["paper"]["mean"] >= 1.0
    page, document = (out / "report.html").read_text(), (out / "reproduces.md").read_text()
    for told in (*paper.SCENARIOS, *(claim.title for claim in claims.CLAIMS)):
        assert told in page
        assert told in document
    assert "{{" not in page
    for figure in ("learning_curves", "learning_curves_paper", "trajectories", "transfer"):
        assert (out / f"{figure}.png").stat().st_size > 10_000
    assert {path.stem for path in (out / "traces").iterdir()} == set(scenarios.SHOWN)
