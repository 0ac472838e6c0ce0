"""The notebook tells its story without an error."""

from pathlib import Path

import nbformat
from nbclient import NotebookClient

STORY = Path(__file__).parents[1] / "docs" / "story.ipynb"


def test_the_story_runs_from_top_to_bottom(monkeypatch):
    monkeypatch.setenv("SKYDOG_QUICK", "1")
    book = nbformat.read(STORY, as_version=4)
    NotebookClient(book, timeout=120, resources={"metadata": {"path": STORY.parent}}).execute()
    code = [cell for cell in book.cells if cell.cell_type == "code"]
    kinds = [kind for cell in code for output in cell.outputs for kind in output.get("data", {})]
    assert kinds.count("image/png") == 9
    told = "".join(output.get("text", "") for cell in code for output in cell.outputs)
    assert "sheepdog: success" in told


def test_the_story_is_kept_without_outputs():
    for cell in nbformat.read(STORY, as_version=4).cells:
        assert not cell.get("outputs")
        assert cell.get("execution_count") is None
