"""The README as a package index shows it: where the code is, its links lead there."""

import os
import re
from typing import Any

from hatchling.metadata.plugin.interface import MetadataHookInterface

REPOSITORY = "PHALANX_REPOSITORY"
"""The variable that says where: https://host/owner/name. Without it links stay relative."""
_LINK = re.compile(r"(?<=\]\()(?!https?://|#)(?=[^)\s]+\))")
_PICTURE = re.compile(r'(?<=src=")(?!https?://)')


class ReadmeHook(MetadataHookInterface):
    """Sets the description of the distribution."""

    def update(self, metadata: dict[str, Any]) -> None:
        with open(os.path.join(self.root, "README.md"), encoding="utf-8") as file:
            text = file.read()
        if repository := os.environ.get(REPOSITORY, "").rstrip("/"):
            text = absolute(text, repository, f"v{metadata['version']}")
            metadata["urls"] = {"Source": repository}
        metadata["readme"] = {"content-type": "text/markdown", "text": text}


def absolute(text: str, repository: str, tag: str) -> str:
    """Return a page whose relative links lead to files of a tag in a repository."""
    linked = _LINK.sub(f"{repository}/blob/{tag}/", text)
    return _PICTURE.sub(f"{repository}/raw/{tag}/", linked)
