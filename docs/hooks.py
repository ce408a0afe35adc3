"""Pages of the site that are made when it is built."""

import sys
from pathlib import Path
from typing import Any

from mkdocs.structure.files import File, Files

ROOT = Path(__file__).resolve().parents[1]


def on_files(files: Files, config: Any) -> Files:
    """Add the page of all messages."""
    sys.path.insert(0, str(ROOT))
    from readygo.apps.error_reference import errors_page

    files.append(File.generated(config, "errors.md", content=errors_page(ROOT)))
    return files
