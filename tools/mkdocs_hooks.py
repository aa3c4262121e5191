"""Hooks for mkdocs: pages for linked source files, and a check of the API reference.

A link such as `[01](../examples/01_plan_a_motion.py)` works where the repository is browsed, but
leads out of the built site. The hooks add each linked file as a page under `sources/`, each linked
folder as a list of its files, and point the links there.

mkdocstrings leaves out a name that it cannot resolve and says nothing; then the last hook stops the
build.
"""

import pathlib
import posixpath
import re

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.exceptions import PluginError
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

import cablecast

ROOT = pathlib.Path(__file__).parents[1]
LINK_OUT_OF_DOCS = re.compile(r"\]\(\.\./([^)#\s]+)\)")
LANGUAGES = {".py": "python", ".yaml": "yaml"}
NOTEBOOK = ".ipynb"


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """State the version at the bottom of each page."""
    config.copyright = f"cablecast {cablecast.__version__}"
    return config


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add a page for each file and folder that documentation pages link to."""
    linked = set()
    for page in files.documentation_pages():
        linked |= set(LINK_OUT_OF_DOCS.findall(page.content_string))
    paths = {ROOT / name for name in linked}
    folders = {path for path in paths if path.is_dir()}
    paths |= {file for folder in folders for file in _listed(folder)}
    for path in sorted(paths):
        if path.suffix == NOTEBOOK:
            # To be downloaded, as the tutorial's pages show what it says.
            content = path.read_text()
        else:
            content = _list_files(path) if path in folders else _show_source(path)
        files.append(File.generated(config, _page_of(path), content=content))
    return files


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Point the links of a page to the pages of the files."""
    here = posixpath.dirname(page.file.src_uri)

    def page_link(link: re.Match) -> str:
        return f"]({posixpath.relpath(_page_of(ROOT / link[1]), here)})"

    return LINK_OUT_OF_DOCS.sub(page_link, markdown)


def on_post_build(config: MkDocsConfig) -> None:
    """Check that the reference shows every public name."""
    shown = (pathlib.Path(config.site_dir) / "reference.html").read_text()
    public = [name for name in getattr(cablecast, "__all__", []) if not name.startswith("_")]
    missing = [name for name in public if f'id="cablecast.{name}"' not in shown]
    if missing:
        raise PluginError(
            f"the reference lacks {', '.join(missing)}: no docstring, or not imported under "
            "`if TYPE_CHECKING` in cablecast/__init__.py"
        )


def _page_of(path: pathlib.Path) -> str:
    suffix = "" if path.suffix == NOTEBOOK else ".md"
    return f"sources/{path.relative_to(ROOT).as_posix()}{suffix}"


def _listed(folder: pathlib.Path) -> list[pathlib.Path]:
    return sorted(path for path in folder.iterdir() if path.suffix in LANGUAGES)


def _list_files(folder: pathlib.Path) -> str:
    items = [f"- [{path.name}]({folder.name}/{path.name}.md)" for path in _listed(folder)]
    return f"# {folder.relative_to(ROOT).as_posix()}\n\n" + "\n".join(items) + "\n"


def _show_source(path: pathlib.Path) -> str:
    title = path.relative_to(ROOT).as_posix()
    language = LANGUAGES.get(path.suffix, "text")
    return f"# {title}\n\n````{language}\n{path.read_text()}````\n"
