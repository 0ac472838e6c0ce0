"""How Sphinx builds the site: `sphinx-build -W --keep-going -b html docs site`."""

import inspect
import re
import sys
import typing
from dataclasses import is_dataclass
from pathlib import Path

# Told before jaxtyping is imported: shapes then stand in signatures as Float[Array, '...'].
typing.GENERATING_DOCUMENTATION = "skydog"  # pyright: ignore[reportAttributeAccessIssue]

import skydog  # noqa: E402

sys.path.insert(0, str(Path(__file__).parent))  # where checks.py is

project = "skydog"
author = "The skydog developers"
version = release = skydog.__version__
extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.mathjax",
    "sphinx.ext.viewcode",
    "checks",
]

html_theme = "furo"
html_title = f"skydog {version}"
html_copy_source = False
templates_path: list[str] = []
exclude_patterns = ["_build"]

myst_enable_extensions = ["dollarmath", "attrs_inline"]
myst_heading_anchors = 4
# The notebook is kept without outputs, so that a diff shows its words. The build runs it, which
# also tests it: an error in a cell fails the build.
nb_execution_mode = "force"
nb_execution_raise_on_error = True
nb_execution_timeout = 1800  # seconds a cell: only a cell that hangs takes so long
# A link to a source file, such as ../src/skydog/world/params.py, is a download here.
suppress_warnings = ["mystnb.unknown_mime_type"]

autodoc_member_order = "bysource"
autodoc_default_options = {"members": True}
autodoc_typehints = "signature"
autodoc_mock_imports = ["stable_baselines3"]  # with torch it would be the largest thing in the lock
autodoc_preserve_defaults = True
python_maximum_signature_line_length = 88
add_module_names = False

CODE = re.compile(r"(?<![`:])`([^`]+)`(?![`_])(?=(\w?))")
FIELD = re.compile(r"^    (\w+): (?!ClassVar)[^#\n]*?(?:# (.*))?$")
REMARK = re.compile(r"^    # (.*)$")


def readable(app, what, name, thing, options, lines):
    """Docstrings name code as Markdown does, `x`; in reStructuredText that is ``x``."""
    if what == "class" and (is_dataclass(thing) or hasattr(thing, "_fields")):
        lines += listed(thing)
    # A letter right behind, as in `Actor`s, needs "\\ " between.
    code = CODE.sub(lambda found: f"``{found[1]}``" + "\\ " * bool(found[2]), "\n".join(lines))
    lines[:] = code.split("\n")


def listed(kind):
    """The fields of a dataclass or a named tuple that carry a comment, above or beside them."""
    found, above = [], []
    for line in inspect.getsource(kind).splitlines():
        remark, field = REMARK.match(line), FIELD.match(line)
        told = " ".join([*above, field[2] or ""]).strip() if field else ""
        if field and told:
            found += ["", f"- `{field[1]}`: {told}"]
        above = [*above, remark[1]] if remark else []
    return ["", *found, ""] if found else []


def short(app, what, name, thing, options, signature, returns):
    """The alias of a plain or traced number by its name."""
    return signature and signature.replace("int | float | Float[Array, '']", "Scalar"), returns


def unnamed(app, what, name, thing, skip, options):
    """A field of a named tuple says nothing but its number; `listed` has what there is to say."""
    return True if str(thing.__doc__).startswith("Alias for field number") else skip


def setup(app):
    """Called by Sphinx."""
    app.connect("autodoc-process-signature", short)
    app.connect("autodoc-skip-member", unnamed)
    app.connect("autodoc-process-docstring", readable)
