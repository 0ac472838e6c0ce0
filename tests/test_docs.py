"""What README and docs say holds: code runs, commands parse, links lead somewhere."""

import inspect
import re
import shlex
from functools import wraps
from importlib import import_module
from pathlib import Path
from urllib.parse import unquote

import pytest
import tyro

import skydog
from skydog import cli, files
from skydog.shepherds import finding

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
NAMES = [str(page.relative_to(ROOT)) for page in PAGES]

BLOCK = re.compile(r"^(?:<!-- not run: (.+?) -->\n)?```(\w+)\n(.*?)^```$", re.M | re.S)
LINK = re.compile(r"\[(?:[^\[\]]|\[[^\]]*\])*\]\(([^()\s]+)\)")


def blocks(page, *languages):
    """The code of a page: why it is not run, if it is not, and itself."""
    found = BLOCK.findall(page.read_text())
    return [(reason, code) for reason, language, code in found if language in languages]


def unfenced(page):
    """A page without its fenced blocks."""
    return re.sub(r"^```.*?^```$", "", page.read_text(), flags=re.M | re.S)


@pytest.mark.parametrize(
    "page", [page for page in PAGES if blocks(page, "python")], ids=lambda page: page.name
)
def test_the_code_of_a_page_runs_from_top_to_bottom(page, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MPLBACKEND", "agg")
    scope = {"__name__": page.stem}
    for number, (reason, code) in enumerate(blocks(page, "python"), 1):
        if not reason:
            exec(compile(code, f"{page.name}, block {number}", "exec"), scope)


NOT_RUN = [
    pytest.param(reason, code, id=f"{page.name}, block {number}")
    for page in PAGES
    for number, (reason, code) in enumerate(blocks(page, "python"), 1)
    if reason
]


@pytest.mark.parametrize(("reason", "code"), NOT_RUN)
def test_code_that_is_not_run_compiles_at_least(reason, code):
    compile(code, "a page", "exec")
    pytest.skip(f"not run: {reason}")


def commands(page):
    """The command lines of `skydog` on a page: in shell blocks, and indented by four."""
    shell = "\n".join(code for _, code in blocks(page, "sh", "console", "bash"))
    lines = re.findall(r"^(?:\$ )?(?:\S*/)?(skydog .*)$", shell, re.M)
    lines += re.findall(r"^    (?:\S*/)?(skydog .*)$", unfenced(page), re.M)
    return [re.sub(r"\s+# .*", "", line) for line in lines]


COMMANDS = sorted({command for page in PAGES for command in commands(page)})


@pytest.mark.parametrize("line", COMMANDS)
def test_a_command_line_parses(line, monkeypatch):
    # What a page names need not be here.
    monkeypatch.setattr(finding, "check", lambda name: None)
    monkeypatch.setattr(files, "exists", lambda path: True)
    _, command, *arguments = shlex.split(line)
    assert parsed(getattr(cli, command), arguments) is not None


def test_a_command_line_that_does_not_exist_is_found_out(capsys):
    with pytest.raises(SystemExit):
        parsed(cli.herd, ["--wolves", "3"])


def parsed(command, arguments):
    """What a command is called with, without calling it."""

    @wraps(command)
    def told(*positional, **options):
        return inspect.signature(command).bind(*positional, **options)

    config = (tyro.conf.OmitArgPrefixes, tyro.conf.FlagCreatePairsOff)
    return tyro.cli(told, args=arguments, config=config)


@pytest.mark.parametrize("page", PAGES, ids=NAMES)
def test_the_links_of_a_page_lead_somewhere(page):
    for target in LINK.findall(re.sub(r"`[^`\n]+`", "code", unfenced(page))):
        if re.match(r"https?:|mailto:", target):
            continue
        path, _, anchor = unquote(target).partition("#")
        if not path and anchor.startswith("skydog."):
            assert exists(anchor), f"{page.name} names {anchor}, which is not"
            continue
        file = (page.parent / path).resolve() if path else page
        assert file.exists(), f"{page.name} links to {target}, which is not there"
        assert ROOT in file.parents
        if anchor:
            assert anchor in anchors(file), f"{page.name} links to {target}: no such heading"


def test_every_page_is_in_the_table_of_contents():
    listed = set(re.findall(r"^\w+$", (ROOT / "docs" / "index.md").read_text(), re.M))
    assert {page.stem for page in PAGES[1:]} - {"index"} <= listed


def test_the_model_has_every_equation_of_the_paper_in_order():
    numbers = re.findall(r"\\tag\{(\d+)\}", (ROOT / "docs" / "model.md").read_text())
    assert list(map(int, numbers)) == list(range(1, 24))


def test_the_disturbances_of_the_twin_are_those_that_ship():
    from skydog.twin import DISTURBANCES

    page = (ROOT / "docs" / "twin.md").read_text()
    rows = re.findall(r"^\| `(\w+)` \| [^|]+ \| ([\d.]+) \| ([\d.]+) \|$", page, re.M)
    told = {name: (float(mild), float(lab)) for name, mild, lab in rows}
    mild, lab = vars(DISTURBANCES["mild"]), vars(DISTURBANCES["lab"])
    assert told == {name: (mild[name], lab[name]) for name in mild}


def test_the_profile_on_the_page_of_the_twin_is_the_one_that_ships():
    ((_, shown),) = blocks(ROOT / "docs" / "twin.md", "toml")
    assert shown == (ROOT / "src/skydog/flight/profiles/crazyflie.toml").read_text()


def test_what_is_cited_is_what_citation_cff_says():
    cited = " ".join((ROOT / "docs" / "cite.md").read_text().split())
    told = (ROOT / "CITATION.cff").read_text()
    for wanted in re.findall(r'title: "(.+)"', told) + re.findall(r'"arXiv:(.+)"', told):
        assert f"{{{wanted}}}" in cited
    for family in re.findall(r"family-names: (.+)", told):
        assert f"{family}, " in cited


def anchors(page):
    """What GitHub and MyST call the headings of a page."""
    headings = re.findall(r"^#+ (.+)$", unfenced(page), re.M)
    plain = [re.sub(r"[^\w\- ]", "", heading.strip().lower()) for heading in headings]
    return {heading.replace(" ", "-") for heading in plain}


def exists(name):
    """Whether a dotted name is that of something in skydog."""
    parts = name.split(".")
    for cut in range(len(parts), 0, -1):
        try:
            found = import_module(".".join(parts[:cut]))
        except ModuleNotFoundError:
            continue
        for part in parts[cut:]:
            if not hasattr(found, part):
                return False
            found = getattr(found, part)
        return found is not skydog
    return False
