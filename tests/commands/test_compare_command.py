"""`skydog compare`, as a user calls it."""

import json


def test_shepherds_are_compared_in_one_table_with_files_and_a_figure(skydog, tmp_path):
    line = "compare strombom strombom-arrive --cases 4 --steps 100 --out found"
    code, out, err = skydog(*line.split())
    assert code == 0
    assert "less strombom" in out
    assert "Ctrl-C keeps the rows" in err
    written = {path.name for path in (tmp_path / "found").iterdir()}
    kept = {"results.json", "results.md", "results.csv"}
    assert written == kept | {"comparison.png", "comparison.svg"}
    code, out, _ = skydog(*line.split(), "--json")
    rows = json.loads(out)["rows"]
    assert rows["strombom-arrive"]["less strombom"]["steps"]["ci95"]


def test_one_shepherd_is_no_comparison(refused):
    assert "two shepherds or more" in refused("compare", "strombom")
    assert "no sheepdog is called rex" in refused("compare", "strombom", "rex")


def test_two_shepherds_of_a_test_are_sent_to_compare(refused):
    said = refused("test", "strombom", "arc", "--cases", "3")
    assert "skydog compare strombom arc" in said
