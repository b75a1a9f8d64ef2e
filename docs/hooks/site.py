"""The hook of mkdocs: pages that are made from the code, and links that leave the documentation."""

import re
from pathlib import PurePosixPath

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

from docs.hooks import reference
from docs.hooks.markdown import nested

_OUT = re.compile(r"\[([^\]]+)\]\(((?:\.\./)+)([^)#\s]+)(#[^)\s]*)?\)")


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Adds the pages of the reference; nothing is written beside the sources."""
    for path, content in reference.pages().items():
        files.append(File.generated(config, path, content=content))
    return files


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """A link to a file of the source tree, which the site does not hold, is shown as that file's path; lists
    are indented as the site wants them.
    """
    depth = len(PurePosixPath(page.file.src_uri).parents) - 1

    def shown(found: re.Match[str]) -> str:
        if found[2].count("/") <= depth:
            return found[0]
        return (
            found[1] if found[1].strip("`") == found[3] else f"{found[1]} (`{found[3]}` in the source tree)"
        )

    return nested(_OUT.sub(shown, markdown))
