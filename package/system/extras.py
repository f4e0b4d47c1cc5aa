"""How what an extra brings is installed: by a line that can be typed where wayfield is."""

import importlib.metadata
import json
from pathlib import Path
from urllib.parse import unquote, urlparse


def installs(extra: str) -> str:
    """Returns the command that adds an extra to this installation, from where it came: a clone, a wheel, an index."""
    try:
        # a clone that is worked in may have another description of it, which does not say
        records = [each.read_text("direct_url.json") for each in importlib.metadata.distributions(name="wayfield")]
        source = json.loads(next(filter(None, records), "{}"))
        url = str(source.get("url", ""))
    except (OSError, ValueError, AttributeError):
        source, url = {}, ""
    place = unquote(urlparse(url).path)
    if url.startswith("file:") and Path(place).exists():
        edits = "-e " if source.get("dir_info", {}).get("editable") else ""
        return f'pip install {edits}"{place}[{extra}]"'
    if url.startswith("file:"):  # it has gone
        return f'pip install ".[{extra}]" in a clone of wayfield'
    kind = source.get("vcs_info", {}).get("vcs")
    return f'pip install "wayfield[{extra}]{f" @ {kind}+{url}" if kind else ""}"'
