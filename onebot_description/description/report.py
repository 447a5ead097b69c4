"""Collecting what is wrong, so that one run shows all of it."""

from xml.etree import ElementTree

from onebot_description.description.reading import Document
from onebot_description.errors import DescriptionError

Element = ElementTree.Element


class Report:
    """Problems and warnings of one document, each prefixed with file, line and element.

    Attributes:
        problems: what makes the description unusable.
        warnings: what works but is probably not meant.
    """

    def __init__(self, document: Document) -> None:
        """Start with nothing found in ``document``."""
        self.document = document
        self.problems: list[str] = []
        self.warnings: list[str] = []
        self._typos: list[str] = []
        self._parents = {child: parent for parent in document.root.iter() for child in parent}

    def problem(self, element: Element, text: str) -> None:
        """Note that ``element`` makes the description unusable."""
        self.problems.append(f"{self.where(element)}: {text}")

    def warning(self, element: Element, text: str) -> None:
        """Note that ``element`` works but is probably not what was meant."""
        self.warnings.append(f"{self.where(element)}: {text}")

    def typo(self, element: Element, text: str) -> None:
        """Warn of a probable slip of the pen; shown with the problems it may have caused."""
        self.warning(element, text)
        self._typos.append(self.warnings[-1])

    def where(self, element: Element) -> str:
        """Return for example ``robot.urdf:12: joint "hip" <limit>``."""
        place = self.document.places.get(element, self.document.shown)
        return f"{place}: {self.label(element)}"

    def label(self, element: Element) -> str:
        """Return for example ``link "base" <visual> <box>``."""
        parts: list[str] = []
        root = self.document.root
        current: Element | None = element
        while current is not None and (current is not root or not parts):
            parts.append(_short(current))
            current = self._parents.get(current)
        return " ".join(reversed(parts))

    def raise_if_any(self) -> None:
        """Raise everything found, if any of it is a problem.

        Raises:
            DescriptionError: all problems, then the slips of the pen that may explain them.
        """
        if self.problems:
            raise DescriptionError([*self.problems, *self._typos])


def local_name(element: Element) -> str:
    """Return the tag without its namespace."""
    return element.tag.rpartition("}")[2]


def _short(element: Element) -> str:
    """``joint "hip"`` for what has a name, else ``<limit>``."""
    name = element.get("name")
    tag = local_name(element)
    return f'{tag} "{name}"' if name and tag != "visual" else f"<{tag}>"
